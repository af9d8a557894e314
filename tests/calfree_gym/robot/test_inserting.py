"""The physics of pegs: what fits goes in, as far beside as its chamfer lets it; what does not, does not."""

import numpy as np
import pytest

from calfree_gym.geometry import quaternion_of
from calfree_gym.robot.inserting import NARROWER, RADIUS, InsertingArm, InsertSimulation
from calfree_gym.world import WorldDistribution

HOLE = np.array([0.4, 0.0, 0.1])
DEEP = 0.02


def pushed(clearance, beside=0.0, lean=0.0):
    """How deep a peg gets (m) that is pushed down in steps of 4 mm, and the largest force on the plate (N).

    Args:
        clearance: Of peg and hole (m).
        beside: From the hole's axis (m).
        lean: Of the plate (rad).
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


def test_a_peg_that_is_too_large_does_not_go_in():
    depth, force = pushed(-0.001)
    assert depth < 0.005
    assert force > 10


@pytest.mark.parametrize("clearance", [0.0005, 0.002, 0.005])
def test_a_chamfer_leads_in_as_far_as_it_goes(clearance):
    led = clearance / 2 + NARROWER
    assert pushed(clearance, 0.8 * led)[0] == pytest.approx(DEEP, abs=1e-3)
    assert pushed(clearance, led + 0.0006)[0] < 0.002


def test_a_thin_plate_may_lean_by_what_is_drawn_and_not_by_what_arms_tilt():
    assert pushed(0.0005, lean=np.radians(5))[0] == pytest.approx(DEEP, abs=1e-3)
    assert pushed(0.0005, lean=np.radians(28))[0] < 0.015


def test_a_peg_that_touches_nothing_presses_on_nothing():
    assert pushed(0.005)[1] == 0
