"""The map from registers to positions where gears ripple and motors are coupled: formula, brute force."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calfree_gym import WorldDistribution, nominal
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.motors import MotorMap, Registers
from calfree_gym.robot.workspace import Workspaces, first_in_view

MOTOR, ONE = 1, slice(0, 1)
ROUNDING = 1e-12


@st.composite
def rippled(draw):
    ripple = (
        np.exp(draw(st.floats(np.log(0.02), np.log(3)))),
        draw(st.floats(-7, 7)),
        draw(st.floats(0, 0.99)),
    )
    others = [(1.0, 0.0, 0.0)] * 2
    curvature, gain = draw(st.floats(-0.45, 0.45)), draw(st.floats(0.5, 2))
    world = replace(
        nominal(),
        gear_ripple=[others[0], ripple, others[1]],
        motor_curvature=[0.2, curvature, -0.2],
        motor_gain=[1, gain, 1],
        motor_sign=[1, draw(st.sampled_from([-1, 1])), -1],
        joint_zeros=[0, draw(st.floats(-0.1, 0.1)), 0, 0],
    )
    return world, ripple


def maps(world):
    motors = MotorMap(1, MOVEMASTER)
    motors.set_world(0, world)
    return motors


def shoulder(motors, registers):
    """Positions (k,) of the shoulder at registers (k,)."""
    at = np.zeros((len(registers), 3))
    at[:, MOTOR] = registers
    return motors.positions(at, ONE)[:, MOTOR]


def gain_there(world, ripple, register):
    period, phase, depth = ripple
    turn = 2 * np.pi / period
    t = register + depth / turn * (np.sin(turn * register + phase) - np.sin(phase))
    c = world.motor_curvature[MOTOR]
    slope = 1 + c * (3 * np.clip(t, -1, 1) ** 2 - 1)
    full = world.motor_sign[MOTOR] * world.motor_gain[MOTOR] * MOVEMASTER.span[MOTOR]
    return full * slope * (1 + depth * np.cos(turn * register + phase))


@settings(max_examples=60)
@given(rippled())
def test_a_rippled_gears_gain_is_that_of_the_formula_and_home_is_home(both):
    world, ripple = both
    motors, plain = maps(world), maps(replace(world, gear_ripple=[1.0, 0.0, 0.0]))
    assert (motors.positions(np.zeros((1, 3)), ONE) == plain.positions(np.zeros((1, 3)), ONE)).all()
    for end in (-1.0, 1.0):
        along = np.linspace(0, end, 4001)
        gains = gain_there(world, ripple, along)
        simpson = (gains[0:-2:2] + 4 * gains[1:-1:2] + gains[2::2]) * (end / 4000) / 3
        integral = np.concatenate([[0], np.cumsum(simpson)])
        found = shoulder(motors, along[::2])
        np.testing.assert_allclose(found - found[0], integral, atol=2e-6)
        assert (np.diff(found) * world.motor_sign[MOTOR] * end > 0).all(), "monotone"
    elsewhere = np.random.default_rng(0).uniform(-1, 1, (9, 3))
    others = [0, 2]
    assert (motors.positions(elsewhere, ONE)[:, others] == plain.positions(elsewhere, ONE)[:, others]).all()


@settings(max_examples=60)
@given(rippled(), st.floats(-1, 1), st.floats(0.1, 1))
def test_a_rippled_gears_inverse_stops_and_reach_are_those_of_brute_force(both, register, reach):
    world, _ = both
    motors = maps(world)
    target = motors.positions(np.full((1, 3), register), ONE)[0]
    again = motors.positions(motors.registers(target, 0)[None], ONE)[0]
    np.testing.assert_allclose(again, target, atol=1e-12)
    dense = np.linspace(-1, 1, 20001)
    positions = shoulder(motors, dense)
    low, high = MOVEMASTER.stops[MOTOR] + np.array([1, -1]) * MOVEMASTER.stop_margin[MOTOR]
    within = dense[(positions >= low) & (positions <= high)]
    lowest, highest = motors.lowest[0, MOTOR], motors.highest[0, MOTOR]
    assert within[0] - 1e-4 <= lowest <= within[0] + ROUNDING
    assert within[-1] - ROUNDING <= highest <= within[-1] + 1e-4
    for end in (lowest, highest):
        at = shoulder(motors, np.array([end]))
        assert np.isclose(abs(end), 1) or np.isclose(at, [low, high], rtol=0, atol=1e-9).any()
    home = motors.positions(np.zeros((1, 3)), ONE)
    candidates = np.repeat(home, len(dense), 0)
    candidates[:, MOTOR] = positions
    reached = motors.reaches(candidates, reach, np.array([0]))
    edge = np.abs(np.abs(dense) - reach) < 1e-9
    assert (reached == (np.abs(dense) <= reach))[~edge].all()


def mixing(coupling):
    """Registers (3,) from the turns of shafts, as a matrix (3, 3)."""
    return np.diag(1 - np.abs(coupling)) + np.diag(coupling[:2], 1) + coupling[2] * np.eye(3, k=-2)


couplings = st.lists(st.floats(-0.4, 0.4), min_size=3, max_size=3).map(np.array)


@settings(max_examples=60)
@given(rippled(), couplings, st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_coupled_motors_are_uncoupled_ones_whose_registers_are_mixed(both, coupling, shafts):
    world, _ = both
    plain, coupled = maps(world), maps(replace(world, motor_coupling=coupling))
    shafts = np.clip(shafts, plain.lowest, plain.highest)
    registers = shafts @ mixing(coupling).T
    there = plain.positions(shafts, ONE)
    np.testing.assert_allclose(coupled.positions(registers, ONE), there, atol=1e-9)
    np.testing.assert_allclose(coupled.registers(there[0], 0), registers[0], atol=1e-9)
    assert (np.abs(registers) <= np.abs(shafts).max() + ROUNDING).all(), "what shafts reach, registers do"


@settings(max_examples=60)
@given(rippled(), couplings, st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_a_coupled_motor_gives_way_only_where_its_own_joint_is_at_its_stop(both, coupling, words):
    """Among all turns within the stops, one alone is such: a linear complementarity problem (P-matrix)."""
    world = replace(both[0], motor_coupling=coupling)
    motors, plain = maps(world), maps(both[0])
    registers = Registers(motors, 1.0)
    registers.set_world(0, world)
    for word in np.reshape(words, (3, 3)):
        goal = registers.executed[0] + word
        there = registers.move(ONE, word[None])[0]
        found = registers.executed[0]
        shafts = np.linalg.solve(mixing(coupling), found)
        np.testing.assert_allclose(there, plain.positions(shafts[None], ONE)[0], atol=1e-9)
        low, high = shafts <= plain.lowest[0] + 1e-9, shafts >= plain.highest[0] - 1e-9
        assert ((shafts >= plain.lowest[0] - 1e-9) & (shafts <= plain.highest[0] + 1e-9)).all()
        assert (found == goal)[~low & ~high].all()
        assert (found >= goal - 1e-9)[low & ~high].all()
        assert (found <= goal + 1e-9)[high & ~low].all()


@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_every_object_of_a_wilder_world_is_one_motion_from_home(mount):
    mounts = MOVEMASTER.mounts(mount)
    for seed in range(4):
        workspace = Workspaces(1, MOVEMASTER, mounts)
        first_in_view(partial(WorldDistribution("wilder").sample, seed), workspace, 0, "a world", whole=True)
        found = workspace.candidates(np.random.default_rng(seed).random((1, 1000, 3)), np.array([0]))
        for point in found.points[found.within & found.reached][:5]:
            registers = workspace.registers_at(0, point)
            assert (np.abs(registers) <= 0.9).all()
            moved = Registers(workspace.motors, 1.0)
            joints = workspace.motors.angles(moved.move(ONE, registers[None]), ONE)
            lengths = workspace._lengths
            np.testing.assert_allclose(MOVEMASTER.gripper_position(joints, lengths)[0], point, atol=1e-4)
