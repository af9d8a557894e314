"""A chain of joints against MuJoCo's kinematics, and its derivatives against differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from agents.body_schema import chain
from agents.body_schema.chain import JointChain, Projection, Triangulation, Views, rotation
from agents.body_schema.fitting import composed
from tests.agents.body_schema.chains import Arm

ARMS = [("redundant.xml", "tool"), ("scara.xml", "tip")]
TURNS = st.tuples(*3 * [st.floats(-1.7, 1.7)]).map(np.array)


@pytest.mark.parametrize(("file", "site"), ARMS)
def test_a_chain_of_an_arms_axes_shows_the_gripper_where_mujoco_has_it(file, site):
    """Seven hinges, and hinges with a slide."""
    arm = Arm(file, site)
    registers = np.random.default_rng(0).uniform(-0.7, 0.7, (20, arm.chain.motors))
    seen = Views(arm.chain, arm.numbers, registers, np.zeros((20, 4))).points[:, :2]
    expected = [[arm.pinhole(arm.gripper(each), camera) for camera in (0, 1)] for each in registers]
    np.testing.assert_allclose(seen, expected, atol=1e-9)


@pytest.mark.parametrize("mount", [1, 3])
def test_a_camera_that_joints_move_sees_the_room_move_the_other_way(mount):
    """The camera's frame is moved as MuJoCo would move a gripper that is fixed behind these joints."""
    arm = Arm("redundant.xml", "tool", mount)
    registers = np.random.default_rng(1).uniform(-0.4, 0.4, arm.chain.motors)
    at_home = np.zeros(arm.chain.motors)
    place = arm.gripper(at_home) + np.array([0.05, -0.1, 0.08])
    home = np.concatenate([arm.pinhole(place, camera) for camera in (0, 1)])
    seen = Views(arm.chain, arm.numbers, registers[None], home[None]).points[0]
    gripper = arm.gripper(registers)
    turn, shift = arm.body_behind(mount, registers)
    turn_at_home, shift_at_home = arm.body_behind(mount, at_home)
    for camera in (0, 1):
        for point, there in ((0, gripper), (2, place)):
            as_at_home = turn_at_home @ turn.T @ (there - shift) + shift_at_home
            np.testing.assert_allclose(seen[point + camera], arm.pinhole(as_at_home, camera), atol=1e-7)


@pytest.mark.parametrize("mounts", [(0, 0), (1, 1), (2, 4)])
def test_derivatives_are_those_of_differences(mounts):
    arm = Arm("redundant.xml", "tool")
    chain, random, step = JointChain(7, mounts), np.random.default_rng(2), 1e-6
    registers, homes = random.uniform(-0.4, 0.4, (3, 7)), random.uniform(-0.2, 0.2, (3, 4))
    numbers = arm.numbers + 0.02 * random.normal(size=chain.size)
    views = Views(chain, numbers, registers, homes)
    derivatives = np.concatenate([views.by_numbers(), views.by_registers()], -1)
    for i in range(chain.size + 7):
        both = []
        for sign in (1, -1):
            moved, there = numbers.copy(), registers.copy()
            if i < chain.size:
                moved[i] += sign * step
            else:
                there[:, i - chain.size] += sign * step
            both.append(Views(chain, moved, there, homes).points)
        np.testing.assert_allclose(derivatives[..., i], (both[0] - both[1]) / (2 * step), atol=2e-6)


def test_several_chains_at_once_are_each_as_alone():
    arm = Arm("redundant.xml", "tool")
    chain, random = JointChain(7, (1, 3)), np.random.default_rng(4)
    registers, homes = random.uniform(-0.4, 0.4, (3, 7)), random.uniform(-0.2, 0.2, (3, 4))
    numbers = arm.numbers + 0.02 * random.normal(size=(2, chain.size))
    both = Views(chain, numbers, registers, homes)
    for several in (lambda views: views.points, Views.by_numbers, Views.by_registers):
        alone = [several(Views(chain, each, registers, homes)) for each in numbers]
        np.testing.assert_allclose(several(both), alone, atol=1e-12)


@given(st.tuples(*3 * [st.floats(-0.4, 0.4)]).map(np.array))
def test_what_two_cameras_see_is_where_they_see_it(offset):
    arm = Arm("redundant.xml", "tool")
    cameras = arm.numbers[arm.chain.cameras].reshape(2, 8)
    place = arm.numbers[arm.chain.gripper] + offset
    sensors = np.concatenate([Projection(camera, place).points for camera in cameras])
    np.testing.assert_allclose(Triangulation(cameras, sensors[None]).places[0], place, atol=1e-4)


@given(TURNS, TURNS)
def test_turns_are_rotations_about_their_axis_and_two_one_after_the_other_are_one(first, second):
    np.testing.assert_allclose(rotation(first), Rotation.from_rotvec(first).as_matrix(), atol=1e-9)
    both = rotation(second) @ rotation(first)
    np.testing.assert_allclose(rotation(composed(second, first)), both, atol=1e-7)


def test_where_a_lens_turns_back_derivatives_stay_finite(monkeypatch):
    """There the derivative of points behind it by those before it is singular."""
    monkeypatch.setattr(chain, "UNDISTORTIONS", 0)
    rng, cameras = np.random.default_rng(0), np.zeros((2, 8))
    cameras[1, 5] = 0.3
    for seen in rng.uniform(-1.5, 1.5, (300, 2)):
        cameras[:, 1] = -1 / (3 * np.square(seen).sum())
        found = chain.Triangulation(cameras, np.array([[*seen, 0, 0.1]]))
        assert np.isfinite(found.derivatives()).all()
