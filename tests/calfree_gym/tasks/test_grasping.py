"""Grasping: that what is held well is lifted, and what is told is true."""

import numpy as np
import pytest

import calfree_gym
from calfree_gym.robot.grasping.shapes import SHAPE_NAMES
from calfree_gym.robot.grasping.simulation import CHUNK, LEAST_CHUNKS, SETTLING
from tests.calfree_gym.environments import make

OPENING, HELD = 23, 4


def registers_before(env, back):
    """Registers at which the gripper is `back` m before the object, on its axis, its edges along the object.

    By the arm's closed form and the object's true pose.
    """
    arms, row = env.unwrapped.arms, np.array([0])
    world, robot, placed = arms.world(0), arms.robot, arms.placed[0]
    rest, pose = robot.rest(world.joint_zeros), placed.pose
    at = robot.positions_at(pose[None, :3], rest, world.link_lengths)
    axis = robot.axis(arms.motors.angles(at[None], row)[0])
    positions = robot.positions_at(pose[None, :3] - back * axis, rest, world.link_lengths)
    if placed.thing.axis[2] == 0:
        turn = pose[3] - positions[0, 0] - np.pi / 2
        positions[0, 3] = -((turn + np.pi / 2) % np.pi - np.pi / 2)
    return arms.motors.registers(positions[0], 0)


def go(env, back, jaws):
    arms = env.unwrapped.arms
    words = [*(registers_before(env, back) - arms.registers[0]), jaws - arms.jaws[0]]
    return env.step(np.array(words, np.float32))


@pytest.fixture
def env():
    return make("Grasp", camera_mount="stand", terminate_on_success=False)


@pytest.mark.parametrize("shape", SHAPE_NAMES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_is_grasped_where_it_is_is_lifted_and_held(shape, seed):
    env = make("Grasp", shape=shape, terminate_on_success=False)
    env.reset(seed=seed)
    go(env, 0.095, 0)
    go(env, 0.0, 0)
    closed, *_ = go(env, 0.0, 1)
    assert closed["achieved_goal"][HELD] == 0, "nothing has moved with the gripper yet"
    assert closed["observation"][OPENING] > 0.1
    observation, _, _, _, info = go(env, 0.1, 1)
    assert observation["achieved_goal"][HELD] == 1
    assert info["truth"]["lifted_mm"] > 50
    assert info["truth"]["distance_mm"] < 30
    observation, *_, info = go(env, 0.1, 0)
    assert observation["achieved_goal"][HELD] == 0, "let go"
    assert info["truth"]["lifted_mm"] < 50


def test_jaws_that_close_on_nothing_hold_nothing(env):
    env.reset(seed=4)
    observation, *_ = go(env, 0.095, 1)
    assert abs(observation["observation"][OPENING]) < 0.02
    observation, *_ = go(env, 0.15, 1)
    assert observation["achieved_goal"][HELD] == 0


def test_rewards_and_ends_follow_from_goals():
    env = make("GraspDense", terminate_on_success=True)
    observation, info = env.reset(seed=5)
    rng = np.random.default_rng(0)
    for _ in range(20):
        words = rng.uniform(-0.2, 0.2, 5).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(words)
        goals = observation["achieved_goal"], observation["desired_goal"]
        assert reward == env.unwrapped.compute_reward(*goals, info)
        assert terminated == env.unwrapped.compute_terminated(*goals, info)
        if truncated:
            break
    there = np.stack([goals[1], goals[1] * [1, 1, 1, 1, 0]])
    assert env.unwrapped.compute_terminated(there, np.stack([goals[1]] * 2), {}).tolist() == [True, False]


@pytest.mark.parametrize("kind", ["vision", "pixels"])
def test_points_that_are_seen_are_found_and_those_that_score_pixels_are_true(opengl, kind):
    env = make("Grasp", observation=kind, camera_mount="stand", image_size=32)
    observation, _ = env.reset(seed=16)
    for _ in range(3):
        assert env.observation_space.contains(observation)
        observation, *_ = env.step(np.full(5, 0.1, np.float32))
    arms = env.unwrapped.arms
    away = np.abs(arms.points - arms.true_points)[arms.visible].max()
    assert (away > 0) == (kind == "vision")
    assert hasattr(env.unwrapped, "compute_reward") == (kind == "vision")
    env.close()


def test_pixels_show_what_is_lifted(opengl):
    env = make("Grasp", observation="pixels", image_size=64, camera_mount="stand")
    first, _ = env.reset(seed=3)
    assert first["pixels"].shape == (64, 64, 6)
    go(env, 0.095, 0)
    go(env, 0.0, 0)
    go(env, 0.0, 1)
    after, *_, info = go(env, 0.1, 1)
    assert after["observation"][-1] > 0.1, "the jaws are open by as much as what they hold"
    assert info["truth"]["lifted_mm"] > 50
    changed = np.abs(after["pixels"].astype(int) - first["pixels"]).max(-1) > 32
    assert 0.005 < changed.mean() < 0.6, "the arm and the object stand elsewhere"
    env.close()


def test_random_motions_neither_press_hard_nor_diverge(env):
    observation, _ = env.reset(seed=9)
    rng, largest = np.random.default_rng(1), 0.0
    for _ in range(200):
        observation, _, terminated, truncated, info = env.step(rng.uniform(-1, 1, 5).astype(np.float32))
        assert env.observation_space.contains(observation)
        assert not info["diverged"]
        largest = max(largest, info["force_table"], info["force_object"])
        if terminated or truncated:
            env.reset()
    assert 0 < largest < 200


@pytest.mark.slow
@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_ten_thousand_random_motions_neither_press_hard_nor_diverge(mount):
    rows, largest = 64, 0.0
    envs = make("Grasp", rows, camera_mount=mount, truth=False)
    envs.reset(seed=9)
    rng = np.random.default_rng(1)
    for _ in range(10_000 // rows):
        observation, _, _, _, info = envs.step(rng.uniform(-1, 1, (rows, 5)).astype(np.float32))
        assert all(np.isfinite(each).all() for each in observation.values())
        assert not info["diverged"].any()
        largest = max(largest, info["force_table"].max(), info["force_object"].max())
    envs.close()
    assert 50 < largest < 200


def test_an_arm_that_presses_goes_back_and_its_registers_say_so(env):
    env.reset(seed=10)
    arms = env.unwrapped.arms
    go(env, 0.02, 0)
    before = arms.registers[0].copy()
    words = [*(registers_before(env, -0.1) - before), 0]
    _, _, _, _, info = env.step(np.array(words, np.float32))
    executed = (arms.registers[0] - before)[:3] / np.array(words[:3])
    assert executed.min() > 0
    assert executed.max() < 0.9
    assert 10 < max(info["force_table"], info["force_object"]) < 200


@pytest.mark.parametrize(
    "do",
    [
        {"type": "motor_gain", "motor": "shoulder", "factor": 1.4},
        {"type": "joint_zero", "joint": "J1", "degrees": 10},
    ],
)
def test_registers_tell_where_an_arm_stands_that_was_stopped_in_a_world_just_changed(do):
    then = [{"at": {"motion": 2}, "do": do}]
    env = make("Grasp", world="nominal", shape="sphere", keep_in_view=False, perturbations=then)
    env.reset(seed=0)
    for words in ([0, -0.3, -0.3, 0, 0], [0.2, -0.05, -0.5, 0, 0], [0.1, -0.15, 0.05, 0, 0]):
        *_, info = env.step(np.array(words, np.float32))
    assert info["force_table"] > 12
    arms = env.unwrapped.arms
    told = arms.motors.joints(arms.registers, slice(None))
    np.testing.assert_allclose(told, arms.simulation._all_ctrl[:, :-1], atol=1e-9)


def test_what_was_tipped_is_not_lifted():
    bar = {"shape": "bar", "half_length": 0.07, "half_width": 0.016, "half_height": 0.012}
    env = make("Grasp", world="nominal", shape=bar)
    env.reset(seed=0)
    simulation = env.unwrapped.arms.simulation
    place = simulation._all_qpos[0, simulation._free : simulation._free + 7]
    place[2:] = [0.07, np.sqrt(0.5), 0, np.sqrt(0.5), 0]
    truth = env.step(np.zeros(5, np.float32))[-1]["truth"]
    assert simulation.heights()[0] > 0.06
    assert truth["lifted_mm"] == 0


def test_an_object_that_leaves_the_table_ends_the_trial_with_a_flag(env):
    env.reset(seed=11)
    arms = env.unwrapped.arms
    free = arms.simulation._free
    arms.simulation._all_qpos[0, free : free + 2] = 1.5, 0.0
    _, _, terminated, truncated, info = env.step(np.zeros(5, np.float32))
    assert (terminated, truncated, bool(info["off_table"])) == (False, True, True)
    assert not env.reset()[1]["off_table"]


def test_physics_that_diverges_ends_the_trial_with_a_flag_and_finite_points(env):
    env.reset(seed=12)
    arms = env.unwrapped.arms
    arms.simulation._qvel[0, -6:] = np.nan
    observation, _, _, truncated, info = env.step(np.zeros(5, np.float32))
    assert truncated
    assert info["diverged"]
    assert env.observation_space.contains(observation)
    env.reset()
    assert not env.step(np.zeros(5, np.float32))[4]["diverged"]


@pytest.mark.parametrize("diverged", [False, True])
@pytest.mark.parametrize("shape", ["sphere", "l_shape"])
def test_a_thing_falls_as_things_do(shape, diverged):
    """By g t² / 2, whatever it weighs; also after the physics of another trial has diverged."""
    env = make("Grasp", shape=shape)
    env.reset(seed=14)
    simulation = env.unwrapped.arms.simulation
    if diverged:
        simulation._qvel[0, -6:] = np.nan
        env.step(np.zeros(5, np.float32))
        assert simulation.diverged
    simulation.place(slice(None), simulation.joints(), np.array([[0.0, 2.0, 3.0, 0.3]]))
    before, turned = simulation.heights(), simulation.configuration(0)[-4:]
    simulation.move(np.array([0]), simulation.joints(), simulation.openings())
    seconds = CHUNK * (LEAST_CHUNKS + SETTLING) * 0.005
    assert before - simulation.heights() == pytest.approx(9.81 * seconds**2 / 2, rel=0.02)
    np.testing.assert_allclose(simulation.configuration(0)[-4:], turned, atol=1e-6)


def test_points_are_where_the_lens_shows_what_is_there(env):
    observation, info = env.reset(seed=13)
    arms, world = env.unwrapped.arms, env.unwrapped.world
    for name, place in (("object", slice(12, 14)), ("gripper", slice(0, 2))):
        seen, _ = arms._workspaces.cameras.project(info["truth"][name][None, None], np.array([0]))
        np.testing.assert_allclose(arms.true_points[0, place], seen[0], atol=1e-9)
    assert np.abs(observation["achieved_goal"][:4] - arms.true_points[0, 12:14].ravel()).max() < 6 / 256
    assert world.object_mass > 0


def test_the_goal_is_where_a_lifted_object_can_be_seen():
    for mount in calfree_gym.MOUNTS:
        env = make("Grasp", camera_mount=mount)
        for seed in range(5):
            observation, _ = env.reset(seed=seed)
            assert np.abs(observation["desired_goal"][:4]).max() < 1
            assert observation["desired_goal"][HELD] == 1


def test_an_object_is_placed_where_it_is_asked_for():
    env = make("Grasp", world="nominal")
    env.reset(seed=15)
    _, info = env.reset(options={"object": (0.40, 0.05, 0.7)})
    np.testing.assert_allclose(info["truth"]["object"][:2], [0.40, 0.05], atol=1e-9)
