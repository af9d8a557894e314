"""Things held in the air: that they stay, that the wrist tilts, and what geometry says of grasps."""

import mujoco
import numpy as np
import pytest

from calfree_gym.geometry import rotation_matrix
from calfree_gym.robot.grasping.held import pressed, surface, ways_to_hold
from calfree_gym.robot.grasping.shapes import SHAPE_NAMES, draw_thing, thing_of
from tests.calfree_gym.environments import make

TILT, TURN = 3, 4
BAR = {"shape": "bar", "half_length": 0.06, "half_width": 0.012, "half_height": 0.015}
BOX = {"shape": "box", "half_length": 0.03, "half_width": 0.015, "half_height": 0.03}
CYLINDER = {"shape": "cylinder", "radius": 0.02, "half_height": 0.03}


def new(**arguments):
    return make("Grasp", orientation="any", camera_mount="stand", **arguments)


def test_a_thing_stays_where_it_is_held_and_falls_as_soon_as_jaws_have_let_it_go():
    env = new(terminate_on_success=False)
    env.reset(seed=1)
    simulation, pose = env.unwrapped.arms.simulation, env.unwrapped.arms.placed[0].pose
    for _ in range(10):
        env.step(np.zeros(6, np.float32))
    np.testing.assert_allclose(simulation.configuration(0)[-7:][:3], pose[:3], atol=2e-4)
    turned = rotation_matrix(simulation.configuration(0)[-7:][3:])
    np.testing.assert_allclose(turned, rotation_matrix(pose[3:]), atol=1e-2)
    simulation.wait(np.array([0]))  # as jaws have closed
    assert simulation.heights()[0] < pose[2] - 0.03


def test_the_words_tilt_and_turn_the_gripper_and_no_other_joint():
    env = new()
    env.reset(seed=2)
    arms = env.unwrapped.arms
    before = arms.simulation.joints()[0]
    for word, joint in ((TILT, 3), (TURN, 4)):
        env.step(0.05 * np.eye(6, dtype=np.float32)[word])
        moved = arms.simulation.joints()[0] - before
        assert abs(moved[joint]) > np.radians(2)
        assert np.abs(np.delete(moved, joint)).max() < np.radians(0.5)
        before = arms.simulation.joints()[0]


def test_postures_are_where_mujoco_has_the_gripper():
    env = new()
    env.reset(seed=3)
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
    env = new(shape=shape)
    env.reset(seed=4)
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


def test_sampled_points_reach_as_far_as_the_thing_itself():
    rng = np.random.default_rng(0)
    for shape in ("cylinder", "sphere"):
        thing = draw_thing(shape, rng)
        radius, half, _ = thing.parts[0].size
        points = surface(thing)
        for direction in rng.normal(size=(20, 3)):
            direction = direction / np.linalg.norm(direction)
            across = np.hypot(*direction[:2])
            far = radius if shape == "sphere" else radius * across + half * abs(direction[2])
            assert far - 0.001 < (points @ direction).max() <= far + 1e-12


def test_a_given_pose_is_where_the_thing_is():
    env, pose = new(shape="box"), np.array([0.4, 0.05, 0.12, 0.5, 0.5, -0.5, 0.5])
    env.reset(seed=8, options={"object": pose})
    np.testing.assert_allclose(env.unwrapped.arms.simulation.configuration(0)[-7:], pose)


def test_a_thing_out_of_reach_has_no_ways():
    env = new(shape="sphere", keep_in_view=False)
    env.reset(seed=7)
    arms = env.unwrapped.arms
    far = np.array([0.9, 0.0, 0.12, 1, 0, 0, 0])
    assert not any(arms.placing.ways(0, arms.world(0), arms.placed[0].thing, far))
