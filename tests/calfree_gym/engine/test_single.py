"""The Gymnasium contract, the black box's promises, and errors that say what is allowed."""

import os
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import calfree_gym
import calfree_gym.envs.single
from calfree_gym import nominal

MOUNTS = calfree_gym.MOUNTS


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("env_id", calfree_gym.ENV_IDS)
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
    env = gym.make("CalFree/Reach-v0", tolerance_px=5.0).unwrapped
    origin, pixel = np.zeros(4, np.float32), np.float32(1 / 256)
    for offset, reached in (([3, 3.9, 0, 0], 1), ([4, 4, 0, 0], 0), ([0, 0, 4, 4], 0), ([3, 3, 3, 3], 1)):
        moved = np.array(offset, np.float32) * pixel
        assert bool(env.compute_terminated(moved, origin, {})) == bool(reached)
        assert env.compute_reward(moved, origin, {}) == reached - 1


def test_only_is_success_tells_where_success_does_not_terminate():
    env = gym.make("CalFree/Reach-v0", tolerance_px=250.0, terminate_on_success=False).unwrapped
    env.reset(seed=0, options={"object": (0.45, 0.0, 0.15)})
    _, _, terminated, _, info = env.step(np.zeros(3))
    assert info["is_success"]
    assert not terminated


def test_same_seed_same_numbers_and_other_seed_other_world():
    def lifetime(seed):
        env = gym.make("CalFree/Reach-v0").unwrapped
        observations = [env.reset(seed=seed)[0]]
        for word in np.random.default_rng(0).uniform(-0.2, 0.2, (5, 3)):
            observations.append(env.step(word)[0])
        observations.append(env.reset()[0])
        return np.array([np.concatenate(list(o.values())) for o in observations]), env.world

    (a, world_a), (b, world_b), (c, world_c) = lifetime(3), lifetime(3), lifetime(4)
    np.testing.assert_array_equal(a, b)
    assert world_a == world_b
    assert not np.array_equal(a, c)
    assert world_a != world_c


def test_objects_do_not_depend_on_how_many_motions_came_before():
    def objects(motions):
        env = gym.make("CalFree/Reach-v0").unwrapped
        env.reset(seed=5)
        found = []
        for _ in range(4):
            for _ in range(motions):
                env.step(np.full(3, 0.05))
            found.append(env.reset()[1]["truth"]["object"])
        return np.array(found)

    np.testing.assert_array_equal(objects(0), objects(7))


def test_noise_has_the_worlds_standard_deviation_and_is_new_at_every_observation():
    env = gym.make("CalFree/Reach-v0", world="nominal", terminate_on_success=False).unwrapped
    env.reset(seed=0)
    errors = []
    for _ in range(400):
        observation, *_, info = env.step(np.zeros(3))
        seen = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
        errors.append((seen - info["truth"]["points"]) * 256)
    errors = np.array(errors)
    assert errors.std() == pytest.approx(0.5, rel=0.05)
    assert abs(np.corrcoef(errors[:-1].ravel(), errors[1:].ravel())[0, 1]) < 0.06


@pytest.mark.parametrize("mount", MOUNTS)
def test_every_trial_starts_at_home_with_all_points_seen_and_apart(mount):
    env = gym.make("CalFree/Reach-v0", camera_mount=mount, tolerance_px=60.0).unwrapped
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        for _ in range(10):
            np.testing.assert_array_equal(observation["observation"], [1, 1, 1, 1, 0, 0, 0])
            assert info["truth"]["error_px"] > 60.0
            assert not info["is_success"]
            assert np.abs(info["truth"]["points"][4:]).max() <= 1 - 16 / 256
            observation, info = env.reset()


@pytest.mark.parametrize("mount", MOUNTS)
def test_every_object_can_be_reached_in_one_motion_and_is_seen_there(mount):
    """Closed-form inverse kinematics of the true world, then one motion of words within 0.9."""
    env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic").unwrapped
    for seed in range(30):
        _, info = env.reset(seed=seed)
        words = _words_to(env, info["truth"]["object"])
        assert np.abs(words).max() <= 0.9 + 1e-6
        observation, _, _, _, info = env.step(words)
        assert info["truth"]["distance_mm"] < 0.01
        assert observation["observation"][:4].all()


def _words_to(env, target):
    """Registers that bring the gripper of a row-0 arm to `target`, by Newton's method on the simulation."""
    from scipy.optimize import least_squares

    from calfree_gym.robot.arms.kinematics import gripper_position

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
    env = gym.make("CalFree/Reach-v0", camera_mount="waist", terminate_on_success=False).unwrapped
    before, _ = env.reset(seed=0)
    lost = False
    for _ in range(12):
        after, *_, info = env.step(np.array([0.2, 0.0, 0.0]))
        for i in range(4):
            key, part = ("achieved_goal", i) if i < 2 else ("desired_goal", i - 2)
            if not after["observation"][i]:
                lost = True
                pair = slice(2 * part, 2 * part + 2)
                np.testing.assert_array_equal(after[key][pair], before[key][pair])
                assert np.abs(info["truth"]["points"][2 * i : 2 * i + 2]).max() > 0.98
        assert env.observation_space.contains(after)
        before = after
    assert lost


@settings(max_examples=30)
@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=8), st.integers(0, 3))
def test_registers_are_executed_sums_within_their_ends(words, seed):
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic", terminate_on_success=False).unwrapped
    env.reset(seed=seed)
    motors, expected = env.arms.motors, np.zeros(3)
    for word in words:
        expected = np.clip(expected + word, motors.lowest[0], motors.highest[0])
        observation, *_ = env.step(np.array(word))
        np.testing.assert_allclose(observation["observation"][4:], expected, atol=1e-6)
    assert np.abs(observation["observation"]).max() <= 1


def test_words_of_zero_move_nothing():
    env = gym.make("CalFree/Reach-v0").unwrapped
    _, info = env.reset(seed=2)
    before = info["truth"]["gripper"]
    *_, info = env.step(np.zeros(3))
    np.testing.assert_array_equal(info["truth"]["gripper"], before)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(2), r"shape \(2,\).*\(3,\)"),
        (np.zeros((1, 3)), r"shape \(1, 3\)"),
        (np.array([0, np.nan, 0]), "finite"),
        (np.array([0, np.inf, 0]), "finite"),
        ("abc", "'abc'; it must be numbers"),
    ],
)
def test_bad_actions(action, message):
    env = gym.make("CalFree/Reach-v0", world="nominal").unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"world": "wlid"}, "'wlid'.*did you mean wild.*nominal, coarse, wild, rough"),
        ({"world": 3}, "unknown world 3"),
        ({"world": {"focal_length": [300, 300]}}, "a World lacks camera_orientation"),
        ({"world": {**nominal().to_dict(), "focus": 1}}, "a World has no field focus"),
        ({"camera_mount": "wrist"}, "'wrist'.*waist, stand"),
        ({"dynamics": "quick"}, "'quick'.*physics, kinematic"),
        ({"tolerance_px": 0}, "tolerance_px is 0"),
        ({"tolerance_px": "4"}, "tolerance_px is '4'"),
        ({"tolerance_px": True}, "tolerance_px is True"),
        ({"observation": "pixel"}, "'pixel'.*pixels"),
        ({"render_mode": "humans"}, "'humans'.*human"),
        ({"keep_in_view": "no"}, "keep_in_view is 'no'; allowed: True, False"),
        ({"terminate_on_success": None}, "terminate_on_success is None; allowed: True, False"),
        ({"tell": 3}, "tell is 3; it must be a sequence of names, such as"),
        ({"perturbations": {"at": 3}}, "must be a list"),
        ({"perturbations": [{"at": {"motoin": 3}, "do": {"type": "camera_roll"}}]}, "did you mean motion"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        calfree_gym.envs.single.StereoArmEnv(**arguments)


def test_before_the_first_reset():
    env = gym.make("CalFree/Reach-v0").unwrapped
    for forbidden in (lambda: env.world, lambda: env.step(np.zeros(3))):
        with pytest.raises(gym.error.ResetNeeded, match=r"reset\(\)"):
            forbidden()


def test_numbers_of_numpy_are_numbers():
    assert gym.make("CalFree/Reach-v0", tolerance_px=np.int64(5)).unwrapped.tolerance_px == 5.0


def test_bad_worlds_and_objects():
    env = gym.make("CalFree/Reach-v0").unwrapped
    env.reset(seed=0)
    away = nominal().camera_orientation[:, [1, 0, 3, 2]] * [-1, 1, -1, 1]
    with pytest.raises(ValueError, match="not in view on the 'waist' mount"):
        env.set_world(_replace(nominal(), camera_orientation=away))
    with pytest.raises(ValueError, match="not in view"):
        gym.make("CalFree/Reach-v0", world=_replace(nominal(), camera_orientation=away))
    with pytest.raises(TypeError, match="str"):
        env.set_world("wild")
    with pytest.raises(ValueError, match="metres"):
        env.reset(options={"object": (0, 0)})
    with pytest.raises(ValueError, match="'here'"):
        env.reset(options={"object": "here"})
    with pytest.raises(ValueError, match="must be a dict"):
        env.reset(options="object")
    with pytest.raises(ValueError, match=r"'objekt'.*'object'"):
        env.reset(options={"objekt": (0.4, 0, 0.1)})
    with pytest.raises(ValueError, match=r"object at \[4.0, 0.0, 0.1\] is 3.58 m from .*; .* within 2.00 m"):
        env.reset(options={"object": (4, 0, 0.1)})
    env.reset(options={"object": (-0.6, 0, 0.1)})  # never reached, but not absurd
    rows = gym.make_vec("CalFree/Reach-v0", num_envs=2)
    with pytest.raises(ValueError, match=r"object at \[0.4, 9.0, 0.1\]"):
        rows.reset(seed=0, options={"object": [(0.4, 0, 0.1), (0.4, 9, 0.1)]})


def _replace(world, **fields):
    from dataclasses import replace

    return replace(world, **fields)


def test_image_without_gl_says_what_to_install(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "none-of-these")
    env = gym.make("CalFree/Reach-v0", world="nominal", render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"libegl1.*MUJOCO_GL=egl"):
        env.render()


def test_a_renderer_that_mujoco_cannot_load_is_named_at_the_import():
    command = [sys.executable, "-c", "import calfree_gym"]
    environment = os.environ | {"MUJOCO_GL": "wayland"}
    failed = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    last = failed.stderr.splitlines()[-1]
    assert last.startswith(
        "gymnasium.error.DependencyNotInstalled: MuJoCo cannot load the renderer of MUJOCO_GL"
    )
    assert "egl (Debian: libegl1" in last


def test_render_without_a_render_mode_shows_nothing():
    env = gym.make("CalFree/Reach-v0", world="nominal").unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="give one to gym.make: rgb_array, human"):
        assert env.render() is None


def test_set_world_holds_over_seeds_and_a_given_world_too():
    world = nominal()
    env = gym.make("CalFree/Reach-v0", world="wild").unwrapped
    env.reset(seed=0)
    env.set_world(world)
    first = env.reset(seed=7)[1]["truth"]["object"]
    assert env.world == world
    given_env = gym.make("CalFree/Reach-v0", world=world).unwrapped
    np.testing.assert_array_equal(given_env.reset(seed=7)[1]["truth"]["object"], first)
    assert not np.array_equal(env.reset(seed=8)[1]["truth"]["object"], first)


def test_robot_seconds_are_travel_at_limited_joint_speed_and_four_seconds_to_settle_and_observe():
    env = gym.make("CalFree/Reach-v0", world="wild", terminate_on_success=False).unwrapped
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
