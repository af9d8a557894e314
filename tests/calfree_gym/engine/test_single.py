"""The Gymnasium contract, the black box's promises, and specs, of which JSON makes the same again."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

import calfree_gym
from calfree_gym import nominal
from calfree_gym.perturbations import CameraRoll, Latency, parse_schedule
from calfree_gym.tasks.reach import PRIVILEGED
from calfree_gym.world import WorldDistribution
from calfree_gym.wrappers import ScaledWords
from tests.arms import own
from tests.arms.every import EVERY, arm_named
from tests.arms.own import ARMS
from tests.calfree_gym.environments import assert_checkers_pass, begun, kinematic, make, trials

MOUNTS = calfree_gym.MOUNTS


OF_ARMS = [env_id for env_id in calfree_gym.ENV_IDS if "Dock" not in env_id]
"""Those of a base are checked in `tasks/test_docking.py`."""


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("env_id", OF_ARMS)
def test_checkers_pass_without_a_warning(env_id, mount):
    assert_checkers_pass(lambda: gym.make(env_id, camera_mount=mount))


@pytest.mark.parametrize("env_id", calfree_gym.ENV_IDS[:2])
def test_reward_and_end_follow_from_the_observation_exactly(env_id):
    env = gym.make(env_id, tolerance_px=60.0).unwrapped
    env.reset(seed=1, options={"object": (0.45, 0.0, 0.15)})
    rng, achieved, desired, rewards, ends = np.random.default_rng(0), [], [], [], []
    for _ in range(60):
        observation, reward, terminated, _, info = env.step(rng.uniform(-0.1, 0.1, 3))
        achieved.append(observation["achieved_goal"])
        desired.append(observation["desired_goal"])
        rewards.append(reward)
        ends.append(terminated)
        assert terminated == info["is_success"]
    assert any(ends)
    assert not all(ends)
    np.testing.assert_array_equal(env.compute_reward(np.array(achieved), np.array(desired), {}), rewards)
    np.testing.assert_array_equal(env.compute_terminated(np.array(achieved), np.array(desired), {}), ends)
    np.testing.assert_array_equal(
        env.compute_truncated(np.array(achieved), np.array(desired), {}), np.zeros(60, bool)
    )


def test_rendezvous_takes_both_cameras_and_euclidean_distance():
    env = make(tolerance_px=5.0).unwrapped
    origin, pixel = np.zeros(4, np.float32), np.float32(1 / 256)
    for offset, reached in (([3, 3.9, 0, 0], 1), ([4, 4, 0, 0], 0), ([0, 0, 4, 4], 0), ([3, 3, 3, 3], 1)):
        moved = np.array(offset, np.float32) * pixel
        assert bool(env.compute_terminated(moved, origin, {})) == bool(reached)
        assert env.compute_reward(moved, origin, {}) == reached - 1


def test_noise_has_the_worlds_standard_deviation_and_is_new_at_every_observation():
    env = begun(make(world="nominal", terminate_on_success=False).unwrapped)
    errors = []
    for _ in range(400):
        observation, *_, info = env.step(np.zeros(3))
        seen = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
        errors.append((seen - info["truth"]["points"]) * 256)
    errors = np.array(errors)
    assert errors.std() == pytest.approx(0.5, rel=0.05)
    assert abs(np.corrcoef(errors[:-1].ravel(), errors[1:].ravel())[0, 1]) < 0.06


def test_objects_of_one_arm_are_those_of_arms_in_rows_in_whatever_world_a_trial_is():
    env, rows, other = kinematic().unwrapped, kinematic(2).unwrapped, kinematic().unwrapped
    other.reset(seed=9)
    env.reset(seed=3)
    rows.reset(seed=3)
    own = env.world
    for trial in range(24):
        if trial in (5, 15):
            world = other.world if trial == 5 else own
            env.set_world(world)
            rows.set_world(world, 0)
        alone, together = (each.reset()[1]["truth"]["object"] for each in (env, rows))
        np.testing.assert_array_equal(alone, together[0])


@pytest.mark.parametrize("mount", MOUNTS)
def test_every_trial_starts_at_home_with_all_points_seen_and_apart(mount):
    env = make(camera_mount=mount, tolerance_px=60.0).unwrapped
    for seed in range(20):
        for observation, info in trials(env, 10, seed):
            np.testing.assert_array_equal(observation["observation"], [1, 1, 1, 1, 0, 0, 0])
            assert info["truth"]["error_px"] > 60.0
            assert not info["is_success"]
            assert np.abs(info["truth"]["points"][4:]).max() <= 1 - 16 / 256


def test_lost_points_keep_their_last_value_and_their_flag_falls():
    env = make(camera_mount="waist", terminate_on_success=False).unwrapped
    before, _ = env.reset(seed=0)
    lost = False
    for _ in range(12):
        after, *_, info = env.step(np.array([0.2, 0.0, 0.0]))
        points, old = (
            np.concatenate([each["achieved_goal"], each["desired_goal"]]).reshape(4, 2)
            for each in (after, before)
        )
        hidden = after["observation"][:4] == 0
        lost |= hidden.any()
        np.testing.assert_array_equal(points[hidden], old[hidden])
        assert (np.abs(info["truth"]["points"].reshape(4, 2)[hidden]).max(-1) > 0.98).all()
        assert env.observation_space.contains(after)
        before = after
    assert lost


@settings(max_examples=30)
@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=8), st.integers(0, 3))
def test_registers_are_executed_sums_within_their_ends(words, seed):
    env = begun(kinematic(terminate_on_success=False).unwrapped, seed)
    motors, expected = env.arms.motors, np.zeros(3)
    for word in words:
        expected = np.clip(expected + word, motors.lowest[0], motors.highest[0])
        observation, *_ = env.step(np.array(word))
        np.testing.assert_allclose(observation["observation"][4:], expected, atol=1e-6)
    assert np.abs(observation["observation"]).max() <= 1


def test_set_world_holds_over_seeds_and_a_given_world_too():
    world = nominal()
    env = begun(make(world="wild").unwrapped)
    env.set_world(world)
    first = env.reset(seed=7)[1]["truth"]["object"]
    assert env.world == world
    given_env = make(world=world).unwrapped
    np.testing.assert_array_equal(given_env.reset(seed=7)[1]["truth"]["object"], first)
    assert not np.array_equal(env.reset(seed=8)[1]["truth"]["object"], first)


def test_robot_seconds_are_travel_at_limited_joint_speed_and_four_seconds_to_settle_and_observe():
    env = make(world="wild", terminate_on_success=False).unwrapped
    _, info = env.reset(seed=0)
    assert info["robot_seconds"] == 0.0
    *_, info = env.step(np.zeros(3))
    assert info["robot_seconds"] == 4.0
    motors, registers = env.arms.motors, env.arms.registers.copy()
    for word in ([0.1, 0.0, 0.0], [0.0, -0.2, 0.05], [-0.3, 0.1, 0.1]):
        before = motors.joints(registers, slice(None))
        *_, info = env.step(np.array(word))
        registers = env.arms.registers.copy()
        travel = np.abs(motors.joints(registers, slice(None)) - before).max()
        assert travel > 0.02
        assert info["robot_seconds"] == pytest.approx(4.0 + travel / 0.7)
    home = env.home_seconds
    *_, info = env.step(-env.arms.registers[0])
    assert info["robot_seconds"] == pytest.approx(home)
    assert env.home_seconds == pytest.approx(4.0)


@pytest.mark.parametrize("name", EVERY)
def test_checkers_pass_without_a_warning_and_spaces_are_as_wide_as_the_arm_has_motors(name):
    arm = arm_named(name)
    for tell in (tuple(PRIVILEGED), ()):
        assert_checkers_pass(lambda tell=tell: make(arm=arm, tell=tell))
    env = make(arm=arm)
    assert env.action_space.shape == (len(arm.motors),)
    assert env.observation_space["observation"].shape == (4 + len(arm.motors),)


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


WORLD = calfree_gym.nominal()
WORLDS = ["nominal", WORLD, WORLD.to_dict(), WorldDistribution("coarse")]
PLAIN = [
    {"at": {"motion": 1}, "do": {"type": "camera_roll", "camera": "left", "degrees": 10.0}},
    {"drift": {"per": "motion"}, "do": {"type": "latency"}},
    {"at": {"motion": 3}, "undo": 0},
]
OF_VALUES = [
    PLAIN[0] | {"do": CameraRoll(camera="left", degrees=np.float64(10.0))},
    PLAIN[1] | {"do": Latency()},
    PLAIN[2],
]
SCHEDULES = [None, PLAIN, OF_VALUES, parse_schedule(PLAIN)]
SCARA = own.ARMS["scara"]


def shown(env, motions=4):
    shape = env.action_space.shape
    found = [env.reset(seed=3)[0]]
    found += [env.step(np.full(shape, 0.05))[0] for _ in range(motions)]
    return [look[key].tolist() for look in found for key in sorted(look)]


def remade(env, make_it=gym.make):
    made = make_it(EnvSpec.from_json(env.spec.to_json()))
    assert json.loads(made.spec.to_json()) == json.loads(env.spec.to_json())
    return made


@settings(max_examples=25)
@given(
    world=st.sampled_from(WORLDS),
    perturbations=st.sampled_from(SCHEDULES),
    arm=st.sampled_from(["movemaster", SCARA, calfree_gym.Arm(**SCARA)]),
    camera_mount=st.sampled_from(["waist", "stand", ("stand", "waist")]),
    tolerance_px=st.sampled_from([4, 5.5, np.float64(3.3), np.int64(5), np.float32(0.1)]),
)
def test_json_makes_the_same_environment(world, perturbations, arm, camera_mount, tolerance_px):
    if arm != "movemaster" and not isinstance(world, str | WorldDistribution):
        world = calfree_gym.nominal(calfree_gym.Arm(**SCARA).robot)
    arguments = {"arm": arm, "camera_mount": camera_mount, "tolerance_px": tolerance_px}
    arguments |= {"world": world, "perturbations": perturbations, "tell": ("joint_angles",)}
    env = kinematic(keep_in_view=False, **arguments)
    copied = remade(env)
    assert shown(copied) == shown(env)
    assert copied.unwrapped.arms.tolerance == env.unwrapped.arms.tolerance


def test_wrappers_stay_in_the_spec():
    env = ScaledWords(make(world=WORLD, max_episode_steps=7), limit=0.5)
    copied = remade(env)
    assert isinstance(copied, ScaledWords)
    assert copied.spec == env.spec
    assert shown(copied) == shown(env)


def test_json_makes_the_same_rows():
    arguments = {"world": [WORLD, "wild", WORLD.to_dict()], "perturbations": OF_VALUES}
    mode = AutoresetMode.SAME_STEP
    rows = make(rows=3, autoreset_mode=mode, max_episode_steps=3, **arguments).unwrapped
    copied = remade(rows, gym.make_vec).unwrapped
    assert copied.autoreset_mode is mode
    assert shown(copied) == shown(rows)
