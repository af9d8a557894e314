"""Registers are what motors were told, whatever they sag; a motor that stays back tells where it stands."""

import numpy as np
import pytest

from tests.calfree_gym.lerobot.so101 import MOTORS


def stand(robot, env):
    """Registers of where motors stand (5,)."""
    at = robot.bus.sync_read("Present_Position", MOTORS[:5])
    return (np.array([*at.values()]) - env.home) / env.unit


def test_a_sagging_arm_tells_what_it_was_told(bench):
    bench = bench()
    env = bench.env
    env.reset()
    told, short, rng = np.zeros(5), [], np.random.default_rng(0)
    for _ in range(8):
        words = np.clip(told + rng.uniform(-0.3, 0.3, 5), -0.4, 0.4) - told
        told = told + words.astype(np.float32)
        observation, *_ = env.step(words)
        np.testing.assert_allclose(observation["observation"][4:], told, atol=1e-5)
        short.append(told - stand(bench.robot, env))
    assert env.unit * np.abs(short).max() > 0.8, "it does sag"


@pytest.mark.parametrize(("word", "stays"), [(0.3, True), (0.07, True), (0.02, False)])
def test_a_jammed_motor_tells_where_it_stands_and_the_others_what_they_were_told(bench, word, stays):
    bench = bench()
    env = bench.env
    env.reset()
    bench.robot.jam("wrist_flex")
    observation, *_ = env.step(np.array([0, 0, 0, word, 0.02]))
    registers = observation["observation"][4:]
    if stays:
        assert registers[3] == pytest.approx(stand(bench.robot, env)[3], abs=0.01)
        assert abs(bench.robot.goals_ahead()[3]) < 0.5, "it does not push"
    else:
        assert registers[3] == pytest.approx(word)
    assert registers[4] <= 0.02 + 1e-6


def test_an_arm_that_has_met_something_stops_as_a_whole(bench):
    """All motors stop with the one that stays back: its word and theirs are executed in part."""
    bench = bench()
    env = bench.env
    env.reset()
    bench.robot.jam("shoulder_pan")
    words = np.array([0.5, 0, 0, 0.5, 0.5])
    observation, *_ = env.step(words)
    executed = observation["observation"][4:][[0, 3, 4]] / 0.5
    assert executed[0] < 0.1
    assert (executed < 0.9).all()


def test_a_motor_is_given_three_times_what_it_usually_lacks(bench):
    """But two degrees at least."""
    bench = bench()
    bench.env.reset()
    motors = bench.env._motors
    for usual, far in ((0.2, 2.0), (1.0, 3.0)):
        for known in motors._usual:
            known.clear()
            known.extend([usual] * 9)
        for short in (0.9 * far, 1.1 * far):
            motors.here = motors.goal - short
            assert motors.stay_back.all() == (short > far)
