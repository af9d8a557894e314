"""The Gymnasium contract, and the black box's promises."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import calfree_gym
from calfree_gym import nominal
from calfree_gym.robot.arms.kinematics import gripper_position
from tests.calfree_gym.environments import kinematic, make, trials

MOUNTS = calfree_gym.MOUNTS


OF_ARMS = [env_id for env_id in calfree_gym.ENV_IDS if "Dock" not in env_id]
"""Those of a base are checked in `tasks/test_docking.py`."""


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("env_id", OF_ARMS)
def test_checkers_pass_without_a_warning(env_id, mount):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, camera_mount=mount).unwrapped, skip_render_check=True)
        sb3_check_env(gym.make(env_id, camera_mount=mount).unwrapped)


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


def test_rendezvous_takes_both_cameras_and_euclidean_distance():
    env = make(tolerance_px=5.0).unwrapped
    origin, pixel = np.zeros(4, np.float32), np.float32(1 / 256)
    for offset, reached in (([3, 3.9, 0, 0], 1), ([4, 4, 0, 0], 0), ([0, 0, 4, 4], 0), ([3, 3, 3, 3], 1)):
        moved = np.array(offset, np.float32) * pixel
        assert bool(env.compute_terminated(moved, origin, {})) == bool(reached)
        assert env.compute_reward(moved, origin, {}) == reached - 1


def test_only_is_success_tells_where_success_does_not_terminate():
    env = make(tolerance_px=250.0, terminate_on_success=False)
    env.reset(seed=0, options={"object": (0.45, 0.0, 0.15)})
    _, _, terminated, _, info = env.step(np.zeros(3))
    assert info["is_success"]
    assert not terminated


def test_noise_has_the_worlds_standard_deviation_and_is_new_at_every_observation():
    env = make(world="nominal", terminate_on_success=False).unwrapped
    env.reset(seed=0)
    errors = []
    for _ in range(400):
        observation, *_, info = env.step(np.zeros(3))
        seen = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
        errors.append((seen - info["truth"]["points"]) * 256)
    errors = np.array(errors)
    assert errors.std() == pytest.approx(0.5, rel=0.05)
    assert abs(np.corrcoef(errors[:-1].ravel(), errors[1:].ravel())[0, 1]) < 0.06


def test_objects_do_not_depend_on_how_many_motions_came_before():
    def objects(motions):
        env, found = kinematic(), []
        for _, info in trials(env, 5, seed=5):
            found.append(info["truth"]["object"])
            for _ in range(motions):
                env.step(np.full(3, 0.05))
        return np.array(found)

    np.testing.assert_array_equal(objects(0), objects(7))


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


@pytest.mark.parametrize("mount", MOUNTS)
def test_every_object_can_be_reached_in_one_motion_and_is_seen_there(mount):
    """Closed-form inverse kinematics of the true world, then one motion of words within 0.9."""
    env = kinematic(camera_mount=mount).unwrapped
    for seed in range(30):
        _, info = env.reset(seed=seed)
        words = _words_to(env, info["truth"]["object"])
        assert np.abs(words).max() <= 0.9 + 1e-6
        observation, _, _, _, info = env.step(words)
        assert info["truth"]["distance_mm"] < 0.01
        assert observation["observation"][:4].all()


def _words_to(env, target):
    """Registers that bring the gripper of a row-0 arm to `target`, by Newton's method on the simulation."""
    motors, lengths = env.arms.motors, env.world.link_lengths

    def miss(registers):
        return gripper_position(motors.joints(registers[None], slice(None))[0, :4], lengths) - target

    starts = [np.zeros(3), *np.random.default_rng(0).uniform(motors.lowest[0], motors.highest[0], (20, 3))]
    for start in starts:
        start = np.clip(start, motors.lowest[0] + 1e-6, motors.highest[0] - 1e-6)
        found = least_squares(miss, start, bounds=(motors.lowest[0], motors.highest[0]), xtol=1e-12)
        if np.abs(found.fun).max() < 1e-6 and np.abs(found.x).max() <= 0.9:
            return found.x
    raise AssertionError("no registers within 0.9 reach the object")


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
    env = kinematic(terminate_on_success=False).unwrapped
    env.reset(seed=seed)
    motors, expected = env.arms.motors, np.zeros(3)
    for word in words:
        expected = np.clip(expected + word, motors.lowest[0], motors.highest[0])
        observation, *_ = env.step(np.array(word))
        np.testing.assert_allclose(observation["observation"][4:], expected, atol=1e-6)
    assert np.abs(observation["observation"]).max() <= 1


def test_set_world_holds_over_seeds_and_a_given_world_too():
    world = nominal()
    env = make(world="wild").unwrapped
    env.reset(seed=0)
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
