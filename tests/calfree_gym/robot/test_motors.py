"""The map from registers to positions where gears ripple, against its formula and against brute force."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from calfree_gym import nominal
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.motors import MotorMap

MOTOR, ONE = 1, slice(0, 1)
ROUNDING = 1e-12


@st.composite
def rippled(draw):
    """A world of which the shoulder's gear ripples, and its ripple."""
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
    """The slope of the shoulder's position over its register, by the chain rule, from the formula."""
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
    """The position is the integral of the gain from home: Simpson's rule, whose step resolves the ripple."""
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
