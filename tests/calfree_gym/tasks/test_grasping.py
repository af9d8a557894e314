"""Grasping: what is held well is lifted, what is told is true, and what geometry says of grasps."""

import mujoco
import numpy as np
import pytest

import calfree_gym
from calfree_gym.geometry import rotation_matrix
from calfree_gym.robot.grasping.held import pressed, surface, ways_to_hold
from calfree_gym.robot.grasping.shapes import SHAPE_NAMES, thing_of
from calfree_gym.robot.grasping.simulation import CHUNK, LEAST_CHUNKS, SETTLING
from tests.calfree_gym.environments import begun, make

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
    env = begun(make("Grasp", shape=shape, terminate_on_success=False), seed)
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


@pytest.mark.parametrize(
    ("mount", "rows", "motions"),
    [
        ("stand", 4, 50),
        *(pytest.param(mount, 64, 156, marks=pytest.mark.slow) for mount in ("waist", "stand")),
    ],
)
def test_random_motions_neither_press_hard_nor_diverge(mount, rows, motions):
    envs = begun(make("Grasp", rows, camera_mount=mount, truth=False), 9)
    rng, largest = np.random.default_rng(1), 0.0
    for _ in range(motions):
        observation, _, _, _, info = envs.step(rng.uniform(-1, 1, (rows, 5)).astype(np.float32))
        assert envs.observation_space.contains(observation)
        assert not info["diverged"].any()
        largest = max(largest, info["force_table"].max(), info["force_object"].max())
    envs.close()
    assert (50 if rows == 64 else 0) < largest < 200


@pytest.mark.parametrize("what", ["off_table", "diverged"])
def test_a_trial_that_cannot_go_on_ends_with_a_flag_and_finite_points(env, what):
    env.reset(seed=11)
    simulation = env.unwrapped.arms.simulation
    if what == "off_table":
        simulation._all_qpos[0, simulation._free : simulation._free + 2] = 1.5, 0.0
    else:
        simulation._qvel[0, -6:] = np.nan
    observation, _, terminated, truncated, info = env.step(np.zeros(5, np.float32))
    assert (terminated, truncated, bool(info[what])) == (False, True, True)
    assert env.observation_space.contains(observation)
    assert not env.reset()[1][what]
    assert not env.step(np.zeros(5, np.float32))[4][what]


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


def test_what_was_tipped_is_not_lifted():
    bar = {"shape": "bar", "half_length": 0.07, "half_width": 0.016, "half_height": 0.012}
    env = begun(make("Grasp", world="nominal", shape=bar))
    simulation = env.unwrapped.arms.simulation
    place = simulation._all_qpos[0, simulation._free : simulation._free + 7]
    place[2:] = [0.07, np.sqrt(0.5), 0, np.sqrt(0.5), 0]
    truth = env.step(np.zeros(5, np.float32))[-1]["truth"]
    assert simulation.heights()[0] > 0.06
    assert truth["lifted_mm"] == 0


@pytest.mark.parametrize("diverged", [False, True])
@pytest.mark.parametrize("shape", ["sphere", "l_shape"])
def test_a_thing_falls_as_things_do(shape, diverged):
    """By g t² / 2, whatever it weighs; also after the physics of another trial has diverged."""
    env = begun(make("Grasp", shape=shape), 14)
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
    env = begun(make("Grasp", world="nominal"), 15)
    _, info = env.reset(options={"object": (0.40, 0.05, 0.7)})
    np.testing.assert_allclose(info["truth"]["object"][:2], [0.40, 0.05], atol=1e-9)


TILT, TURN = 3, 4
BAR = {"shape": "bar", "half_length": 0.06, "half_width": 0.012, "half_height": 0.015}
BOX = {"shape": "box", "half_length": 0.03, "half_width": 0.015, "half_height": 0.03}
CYLINDER = {"shape": "cylinder", "radius": 0.02, "half_height": 0.03}


def new(**arguments):
    return make("Grasp", orientation="any", camera_mount="stand", **arguments)


def test_a_thing_stays_where_it_is_held_and_falls_as_soon_as_jaws_have_let_it_go():
    env = begun(new(terminate_on_success=False), 1)
    simulation, pose = env.unwrapped.arms.simulation, env.unwrapped.arms.placed[0].pose
    for _ in range(10):
        env.step(np.zeros(6, np.float32))
    np.testing.assert_allclose(simulation.configuration(0)[-7:][:3], pose[:3], atol=2e-4)
    turned = rotation_matrix(simulation.configuration(0)[-7:][3:])
    np.testing.assert_allclose(turned, rotation_matrix(pose[3:]), atol=1e-2)
    simulation.wait(np.array([0]))  # as jaws have closed
    assert simulation.heights()[0] < pose[2] - 0.03


def test_the_words_tilt_and_turn_the_gripper_and_no_other_joint():
    env = begun(new(), 2)
    arms = env.unwrapped.arms
    before = arms.simulation.joints()[0]
    for word, joint in ((TILT, 3), (TURN, 4)):
        env.step(0.05 * np.eye(6, dtype=np.float32)[word])
        moved = arms.simulation.joints()[0] - before
        assert abs(moved[joint]) > np.radians(2)
        assert np.abs(np.delete(moved, joint)).max() < np.radians(0.5)
        before = arms.simulation.joints()[0]


def test_postures_are_where_mujoco_has_the_gripper():
    env = begun(new(), 3)
    arms = env.unwrapped.arms
    world, place = arms.world(0), arms.placed[0].pose[:3]
    pitch = next(arms.placing.ways(0, world, arms.placed[0].thing, arms.placed[0].pose)).pitch
    at, before = arms.placing.postures(0, world, place, pitch)
    points = []
    for joints in (at, before):
        arms.simulation.place(np.array([0]), joints[None], arms.placed[0].pose[None])
        arms.simulation.refresh()
        points.append(arms.simulation.positions()[0][0])
    np.testing.assert_allclose(points[0], place, atol=1e-6)
    way = points[0] - points[1]
    assert np.linalg.norm(way) == pytest.approx(0.092)
    forward = way @ [np.cos(at[0]), np.sin(at[0]), 0.0]
    assert np.arctan2(way[2], forward) == pytest.approx(pitch, abs=1e-6)


@pytest.mark.parametrize(
    ("thing", "line", "square", "flush"),
    [
        (BAR, [0, 1, 0], 1, 1),
        (BAR, [1, 0, 0], 0, 0),  # its ends are too far apart
        (BAR, [0, 0.6, 0.8], 0.8, 1),
        (BAR, [0.6, 0, 0.8], 0.8, 0.8),
        (BOX, [0.6, 0, 0.8], 0.8, 1),
        (CYLINDER, [0.6, 0.8, 0], 1, 1),
        (CYLINDER, [0, 0.6, 0.8], 0.8, 1),
        (CYLINDER | {"half_height": 0.05}, [0, 0.6, 0.8], 0.6, 0.6),
        ({"shape": "sphere", "radius": 0.02}, [0.6, 0, 0.8], 1, 1),
    ],
)
def test_jaws_press_along_normals_of_faces_that_fit_between_them(thing, line, square, flush):
    assert pressed(thing_of(thing), np.array(line)) == pytest.approx((square, flush))


def test_a_thing_is_held_across_and_not_where_it_is_too_wide_or_in_the_way_of_the_palm():
    straight_down, turned = -np.pi / 2, np.eye(3)
    rolls = [way.roll for way in ways_to_hold(thing_of(BAR), turned, straight_down, 0.0, 0.6)]
    assert rolls
    assert all(abs(roll - np.pi / 2) < np.radians(30) for roll in rolls), "at roll 0 edges lie across the bar"
    long = BAR | {"half_length": 0.10}
    upright = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    assert ways_to_hold(thing_of(BAR), upright, straight_down, 0.0, 0.6), "it ends before the palm"
    assert not ways_to_hold(thing_of(long), upright, straight_down, 0.0, 0.6), "it does not"


@pytest.mark.parametrize("shape", SHAPE_NAMES)
def test_sampled_points_lie_in_the_thing_that_mujoco_has_and_reach_its_ends(shape):
    env = begun(new(shape=shape), 4)
    thing, simulation = env.unwrapped.arms.placed[0].thing, env.unwrapped.arms.simulation
    model, _ = simulation.show(0, simulation.picture())
    points = surface(thing)
    for point in points[:: len(points) // 50]:
        inside = False
        for geom in (model.geom("object_1"), model.geom("object_2")):
            if model.geom_contype[geom.id]:
                away, (first, second, third) = point - model.geom_pos[geom.id], model.geom_size[geom.id]
                inside |= {
                    mujoco.mjtGeom.mjGEOM_SPHERE: np.linalg.norm(away) <= first + 1e-9,
                    mujoco.mjtGeom.mjGEOM_CYLINDER: np.hypot(*away[:2]) <= first + 1e-9
                    and abs(away[2]) <= second + 1e-9,
                    mujoco.mjtGeom.mjGEOM_BOX: (np.abs(away) <= [first, second, third + 1e-9]).all(),
                }[mujoco.mjtGeom(model.geom_type[geom.id])]
        assert inside
    assert np.abs(points @ thing.axis).max() >= 0.9 * thing.axis @ thing.axis


def test_a_thing_out_of_reach_has_no_ways():
    env = begun(new(shape="sphere", keep_in_view=False), 7)
    arms = env.unwrapped.arms
    far = np.array([0.9, 0.0, 0.12, 1, 0, 0, 0])
    assert not any(arms.placing.ways(0, arms.world(0), arms.placed[0].thing, far))


def test_a_given_pose_is_where_the_thing_is():
    env, pose = new(shape="box"), np.array([0.4, 0.05, 0.12, 0.5, 0.5, -0.5, 0.5])
    env.reset(seed=8, options={"object": pose})
    np.testing.assert_allclose(env.unwrapped.arms.simulation.configuration(0)[-7:], pose)
