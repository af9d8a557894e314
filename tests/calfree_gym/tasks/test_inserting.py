"""Inserting: a peg that is led along the axis goes in, and what is told is true."""

import numpy as np
import pytest

from calfree_gym.geometry import quaternion_of, rotation_matrix
from calfree_gym.robot.inserting import CLEAR, LEANS, NARROWER, RADIUS, InsertingArm, InsertSimulation
from calfree_gym.tasks.insert import depth_told
from calfree_gym.world import WorldDistribution
from tests.calfree_gym.environments import begun, make


def go(env, ahead, beside=0.0):
    """Brings the peg's end before (m, negative) or beyond the hole, along the gripper, by the closed form."""
    arms, row = env.unwrapped.arms, np.array([0])
    world, robot, hole = arms.world(0), arms.robot, arms.poses[0, :3]
    rest = robot.rest(world.joint_zeros)
    at = robot.positions_at(hole[None], rest, world.link_lengths)
    axis = robot.axis(arms.motors.angles(at[None], row)[0])
    side = np.cross(axis[0], [0, 0, 1.0])
    place = hole + ahead * axis + beside * side / np.linalg.norm(side)
    registers = arms.motors.registers(robot.positions_at(place, rest, world.link_lengths)[0], 0)
    return env.step((registers - arms.registers[0]).astype(np.float32))


def test_a_peg_beside_the_plate_is_not_in():
    axis, visible = np.array([[0.0, 0.4], [0.05, 0.4]]), np.ones(1, bool)
    for across, told in ((0.03, 0.2), (0.2, 0.0)):
        way = 0.2 * axis + [[across, 0.0], [across, 0.0]]
        depth = depth_told(np.zeros((1, 2, 2)) + way, (way - axis)[None], np.zeros((1, 2, 2)), visible)
        assert depth == pytest.approx(told, abs=0.02)
    assert depth_told(-way[None], (-way - axis)[None], np.zeros((1, 2, 2)), visible) < -0.1, (
        "above it, as ever"
    )


@pytest.mark.parametrize("mount", ["waist", "stand"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_peg_that_is_led_along_the_axis_goes_in(mount, seed):
    env = begun(make("Insert", camera_mount=mount, terminate_on_success=False), seed)
    observation, *_, info = go(env, -0.05)
    assert info["truth"]["depth_mm"] == pytest.approx(-50, abs=1)
    assert observation["achieved_goal"][4] == pytest.approx(-50 / 92, abs=0.15), "perspective bends it"
    assert not info["is_success"]
    for ahead in (-0.02, -0.004, 0.005, 0.014, 0.024):  # joints do not move the peg along a line
        observation, reward, *_, info = go(env, ahead)
    assert info["truth"]["depth_mm"] == pytest.approx(24, abs=1.5)
    assert info["is_success"]
    assert reward == 0
    assert env.unwrapped.is_solved(info["truth"])
    goals = observation["achieved_goal"], observation["desired_goal"]
    assert env.unwrapped.compute_reward(*goals, {}) == reward


def test_beside_the_hole_is_the_plate_and_a_guard():
    env = begun(make("Insert"), 4)
    go(env, -0.02, 0.005)
    for ahead in np.arange(-0.016, 0.01, 0.004):
        *_, info = go(env, ahead, 0.005)
        assert info["truth"]["depth_mm"] < 2
        assert not info["is_success"]
    assert 10 < info["truth"]["force"] < 30
    assert info["truth"]["force"] >= info["force_plate"]


def test_plates_lean_as_the_gripper_does_and_arms_begin_above_them():
    env = make("Insert").unwrapped
    for seed in range(5):
        _, info = env.reset(seed=seed)
        arms = env.arms
        angles, reached = arms._holes.joints_at(0, arms.world(0), arms.poses[:1, :3])
        upwards = rotation_matrix(arms.poses[0, 3:])[:, 2]
        assert reached.all()
        assert -upwards @ arms.robot.axis(angles)[0] >= np.cos(LEANS) - 1e-9
        assert info["truth"]["depth_mm"] < -1000 * CLEAR
        assert arms.visible[0].all()


def test_the_hole_may_be_given():
    env = begun(make("Insert", world="nominal", camera_mount="stand"))
    _, info = env.reset(options={"object": (0.4, 0.05, 0.1)})
    np.testing.assert_allclose(info["truth"]["object"], [0.4, 0.05, 0.1])


HOLE = np.array([0.4, 0.0, 0.1])
DEEP = 0.02


def pushed(clearance, beside=0.0, lean=0.0):
    """How deep a peg gets (m) that is pushed down in steps of 4 mm, and the largest force on the plate (N).

    Peg and hole have a clearance (m), the peg comes down beside the axis (m), and the plate leans (rad).
    """
    robot = InsertingArm(clearance)
    simulation = InsertSimulation(1, robot, robot.mounts("stand"), 1)
    world = WorldDistribution("nominal").sample(0, 0, 0, robot)
    simulation.set_world(0, world)
    rest, one = robot.rest(world.joint_zeros), np.array([0])

    def joints(height):
        place = HOLE + np.array([beside, 0, height])
        return robot.angles(robot.positions_at(place[None], rest, world.link_lengths), rest[None])

    c, s = np.cos(lean), np.sin(lean)
    turn = quaternion_of(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    simulation.place(slice(None), joints(0.03), np.concatenate([HOLE, turn])[None])
    largest = 0.0
    for height in np.arange(0.004, -DEEP - 0.002, -0.004):
        motion = simulation.move(one, joints(height), np.array([RADIUS]))
        largest = max(largest, float(motion.forces[0, 1]))
        if motion.shares[0] < 1:
            break
    simulation.refresh()
    return float(simulation.tips()[0][0]), largest


FREE, STUCK = (DEEP - 1e-3, DEEP + 1e-3), (0, 0.002)


@pytest.mark.parametrize(
    ("clearance", "beside", "degrees", "deep"),
    [
        *((clearance, 0.8, 0, FREE) for clearance in (0.0005, 0.002, 0.005)),
        *((clearance, None, 0, STUCK) for clearance in (0.0005, 0.002, 0.005)),
        (0.0005, 0, 5, FREE),
        (0.0005, 0, 28, (0, 0.015)),
        (-0.001, 0, 0, (0, 0.005)),
    ],
)
def test_a_chamfer_leads_in_as_far_as_it_goes_and_a_thin_plate_may_lean_a_little(
    clearance, beside, degrees, deep
):
    """The peg is a share of what the chamfer leads beside the axis, or 0.6 mm more than that."""
    led = clearance / 2 + NARROWER
    away = led + 0.0006 if beside is None else beside * led
    depth, force = pushed(clearance, away, np.radians(degrees))
    assert deep[0] - 1e-3 <= depth < deep[1]
    if clearance < 0:
        assert force > 10


def test_a_peg_that_touches_nothing_presses_on_nothing():
    assert pushed(0.005)[1] == 0
