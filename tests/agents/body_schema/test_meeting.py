"""Where gripper and object meet, against MuJoCo's kinematics."""

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.base.registers import Stops
from agents.body_schema.body_schema import MeetingSeeker
from tests.agents.body_schema.chains import Arm


def seeker(arm, target, stops=None, offset=0.0):
    nothing = np.zeros(arm.chain.motors)
    place = arm.gripper(target)
    home = np.concatenate([arm.pinhole(place, camera) for camera in (0, 1)])
    gripper = np.concatenate([arm.pinhole(arm.gripper(nothing), camera) for camera in (0, 1)])
    points = np.concatenate([gripper, home]).reshape(4, 2)
    now = Observation(points + offset, np.ones(4, bool), nothing)
    return MeetingSeeker(arm.exact, home, now, 0.5, stops or Stops(nothing)), place


@pytest.mark.parametrize("seed", range(5))
def test_mujoco_has_the_gripper_at_the_object_there(seed):
    arm = Arm("redundant.xml", "tool")
    target = np.random.default_rng(seed).uniform(-0.5, 0.5, arm.chain.motors)
    found, place = seeker(arm, target)
    meeting = found.seek()
    assert meeting.deviation_px < 4
    assert np.linalg.norm(arm.gripper(meeting.registers) - place) < 0.02


def test_motors_stay_between_their_stops():
    arm = Arm("redundant.xml", "tool")
    stops = Stops(np.zeros(arm.chain.motors))
    stops.found[:, 1] = -0.05, 0.05
    found, place = seeker(arm, np.r_[0.1, 0.1, -0.1, 0.2, 0.1, 0.1, 0.0], stops)
    registers = found.seek().registers
    assert abs(registers[1]) <= 0.05
    assert np.linalg.norm(arm.gripper(registers) - place) < 0.02


def test_the_jacobian_is_that_of_the_points():
    arm = Arm("scara.xml", "tip")
    registers = np.r_[0.2, -0.3, 0.1, 0.0][: arm.chain.motors]
    home = np.concatenate([arm.pinhole(arm.gripper(registers), camera) for camera in (0, 1)])
    jacobian = arm.exact.jacobian(registers, home)
    for motor, step in enumerate(1e-5 * np.eye(arm.chain.motors)):
        both = [
            [arm.pinhole(arm.gripper(registers + sign * step), camera) for camera in (0, 1)]
            for sign in (1, -1)
        ]
        slope = (np.array(both[0]) - both[1]).ravel() / 2e-5
        np.testing.assert_allclose(jacobian[:4, motor], slope, atol=1e-4)
