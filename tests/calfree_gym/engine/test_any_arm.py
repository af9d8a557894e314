"""The environment of any arm keeps to the interfaces; spaces are as wide as it has motors."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from calfree_gym.tasks.reach import PRIVILEGED
from tests.arms.every import EVERY, arm_named
from tests.arms.own import ARMS, MOTORS
from tests.calfree_gym.environments import kinematic, make


@pytest.mark.parametrize("name", EVERY)
def test_checkers_pass_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(arm=arm_named(name)).unwrapped, skip_render_check=True)
        sb3_check_env(make(arm=arm_named(name)).unwrapped)


@pytest.mark.parametrize("name", ARMS)
def test_spaces_are_as_wide_as_the_arm_has_motors(name):
    motors = len(MOTORS[name])
    env = kinematic(arm=ARMS[name], tell=tuple(PRIVILEGED))
    assert env.action_space.shape == (motors,)
    assert env.observation_space["observation"].shape == (4 + motors,)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    rng = np.random.default_rng(0)
    for _ in range(5):
        observation, _, _, _, info = env.step(rng.uniform(-1, 1, motors).astype(np.float32))
        assert env.observation_space.contains(observation)
        assert observation["joint_angles"] == pytest.approx(info["truth"]["joints"], rel=1e-6)


def test_an_arm_by_name_by_value_and_as_a_mapping_are_the_same():
    def seen(**arm):
        return make(camera_mount="stand", **arm).reset(seed=4)[0]["desired_goal"].tolist()

    hobby = arm_named("hobby")
    assert seen(arm=hobby) == seen(arm=ARMS["hobby"]) == seen(arm=hobby.to_dict())
    assert seen() == seen(arm="movemaster")


def test_what_is_told_keeps_to_its_bounds_where_joints_turn_often_and_the_arm_stands_far_away():
    text = ARMS["scara"]["model"].read_text()
    text = text.replace('range="-360 360"', 'range="-900 900"')
    text = text.replace('name="column"', 'name="column" pos="30 9 2"')
    arm = {"model": text, "gripper": "tip", "home": {"roll": 12.0}}
    env, turned = kinematic(arm=arm, tell=("joint_angles", "gripper_position")), []
    env.reset(seed=0)
    for word in ([0, 0, 0, 1], [0, 0, 0, -1], [0, 0, 0, -1]):
        observation, *_ = env.step(np.array(word, np.float32))
        assert env.observation_space.contains(observation)
        turned.append(np.abs(observation["joint_angles"]).max())
    assert max(turned) > 2 * np.pi
