"""The calibrated robot against the simulation that it models, and against the numbers asked of it."""

from dataclasses import fields, replace
from itertools import islice

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
import calfree_gym
from agents.base.observation import Observation
from agents.calibrated.robot_model import RobotModel
from calfree_gym.perturbations import CameraRoll
from experiments.evaluation import evaluate
from tests.agents.trials import STAND_FIRST, motions_of

MOUNTS = calfree_gym.MOUNTS


@pytest.mark.parametrize("seed", [3000, 3001, 3002])
def test_the_model_of_a_world_is_the_simulation(make_env, mount, seed):
    """Joints, gripper and images of both points, all over the motors' range, in worlds all wild."""
    env, rng = make_env(mount).unwrapped, np.random.default_rng(seed)
    env.reset(seed=seed)
    model = RobotModel.of(env.world, mount)
    for _ in range(30):
        observation, *_, info = env.step(rng.uniform(-0.4, 0.4, 3))
        registers, truth = observation["observation"][4:].astype(float), info["truth"]
        joints = model.joints(registers[None])
        np.testing.assert_allclose(joints[0], truth["joints"][:4], atol=1e-5)
        gripper = model.gripper(joints)
        np.testing.assert_allclose(gripper[0], truth["gripper"], atol=1e-5)
        seen = model.image(np.stack([gripper[0], truth["object"]]), np.repeat(joints, 2, 0))
        inside = np.repeat(np.abs(truth["points"].reshape(4, 2)).max(1) < 1, 2)
        np.testing.assert_allclose(seen.ravel()[inside], truth["points"][inside], atol=1e-4)


unit = st.floats(-1.0, 1.0)


@settings(max_examples=60)
@given(st.sampled_from(MOUNTS), st.integers(0, 4), st.tuples(unit, unit, unit))
def test_triangulation_undoes_the_cameras_and_inverse_kinematics_the_arm(mount, seed, place):
    world = calfree_gym.WorldDistribution("wild").sample(seed)
    model = RobotModel.of(world, mount)
    point = np.array([0.40, 0.0, 0.14]) + np.array([0.08, 0.1, 0.1]) * place
    registers = model.registers(point)
    joints = model.joints(registers[None])
    np.testing.assert_allclose(model.gripper(joints)[0], point, atol=1e-5)
    np.testing.assert_allclose(
        model.triangulate(model.image(point[None], joints), joints)[0], point, atol=1e-6
    )


@pytest.mark.parametrize("tilt", [-0.35, 0.0, 0.2])
def test_inverse_kinematics_where_the_wrist_meets_its_limit(tilt):
    """An arm stretched out and low bends the wrist to its stop: forearm and hand then move as one."""
    world = replace(calfree_gym.nominal(), joint_zeros=np.array([0.0, tilt, 0.0, tilt]))
    model = RobotModel.of(world, "stand")
    stopped = 0
    for shoulder in np.linspace(-0.15, 0.3, 8):
        for elbow in np.linspace(-0.3, 0.6, 12):
            joints = model.joints(np.array([[0.1, shoulder, elbow]]))
            if not -2.0 < joints[0, 2] < 0:
                continue
            stopped += joints[0, 3] < -1.9
            point = model.gripper(joints)[0]
            found = model.joints(model.registers(point)[None])
            np.testing.assert_allclose(model.gripper(found)[0], point, atol=1e-4)
    assert stopped > 5


def test_several_models_at_once_are_each_of_them():
    worlds = [calfree_gym.WorldDistribution("wild").sample(seed) for seed in range(4)]
    models = [RobotModel.of(world, "waist") for world in worlds]
    arrays = [field.name for field in fields(RobotModel) if field.name != "cameras_on_waist"]
    together = replace(
        models[0], **{name: np.stack([getattr(model, name) for model in models]) for name in arrays}
    )
    registers = np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3))
    joints = together.joints(registers)
    seen = together.image(together.gripper(joints), joints)
    for i, model in enumerate(models):
        alone = model.joints(registers)
        np.testing.assert_allclose(seen[i], model.image(model.gripper(alone), alone))


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_the_nominal_robot_reaches_at_once(mount, dynamics):
    env = gym.make("CalFree/Reach-v0", world="nominal", camera_mount=mount, dynamics=dynamics)
    records = evaluate(agents.make("model_based", env, camera_mount=mount), env, trials=200, seed=3000)
    assert np.mean([record.rendezvous for record in records]) >= 0.995
    assert max(record.motions for record in records) <= 2


def test_one_camera_rolled_breaks_its_aim(make_env, mount):
    """The paper's section 2.2: an error in one of many coefficients may be enough."""
    misses = []
    for degrees in (0.0, 15.0, 45.0):
        world = CameraRoll("left", degrees).apply(calfree_gym.nominal(), np.random.default_rng(0))
        env = make_env(mount, world=world, max_episode_steps=1)
        records = evaluate(agents.make("model_based", env, camera_mount=mount), env, trials=40, seed=3000)
        misses.append(np.median([record.error_px for record in records]))
    assert misses[0] < 4 < 8 < misses[1] < 2 * misses[1] < misses[2]


def test_a_motion_that_loses_a_point_is_taken_back_by_half(make_env):
    """After observations enough to know that it is lost."""
    env = make_env(world="nominal")
    agent = agents.make("model_based", env)
    observation = Observation.of(env.reset(seed=1)[0])
    running = agent.procedure(observation, agent.new_findings())
    goal = next(running)
    lost = replace(observation, registers=goal, visible=np.array([True, True, False, True]))
    words = [running.send(lost) for _ in range(6)]
    moving = [word for word in words if word.any()]
    assert not words[0].any()
    np.testing.assert_allclose(moving[0], -goal / 2)


def test_where_the_model_is_right_an_observation_is_a_motion(make_env, mount):
    """Trusted observations cost nothing: no zero words, and no doubt about noise as usual."""
    env = make_env(mount, world="nominal", terminate_on_success=False)
    agent = agents.make("model_based", env, camera_mount=mount)
    for seed in range(10):
        made = [words for words, *_ in islice(motions_of(agent, env, seed=seed), 4)]
        assert np.any(made, axis=1).all()


@pytest.mark.parametrize("mount", STAND_FIRST)
def test_a_goal_seen_in_noise_is_averaged(make_env, mount):
    """20 px on every coordinate: trusting the last observation alone ends 30 px off in the median."""
    world = replace(calfree_gym.nominal(), point_noise=np.asarray(20.0))
    env = make_env(mount, world=world, terminate_on_success=False)
    records = [
        evaluate(agents.make("model_based", env, camera_mount=mount), env, trials=1, seed=seed)[0]
        for seed in range(3000, 3015)
    ]
    assert np.median([record.error_px for record in records]) < 14
