"""When the world has changed: told from errors alone, and not from noise."""

from dataclasses import replace

import numpy as np
import pytest

from agents.neural.self_supervised.change_detector import ErrorDetector, JudgedMotion


def lives(rng, motions, scale=0.1, signs=(1, 1, 1), start=0):
    """Motions of a network whose relative errors are log-normal: heavy tails, as real ones have."""
    for i in range(start, start + motions):
        made = rng.normal(size=3)
        off = rng.normal(size=3)
        said = made * signs + scale * np.exp(1.2 * rng.normal()) * off / np.linalg.norm(off)
        yield JudgedMotion(made, said, float(np.linalg.norm(made)), moment=i, trial=i // 3)


def found(detector, motions):
    return [change for each in motions if (change := detector.observe(each)) is not None]


def used_to(rng):
    """A detector that has seen 300 motions of a network, in which nothing changed."""
    detector = ErrorDetector(3)
    assert found(detector, lives(rng, 300)) == []
    return detector


def test_errors_of_heavy_tails_are_no_change():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        assert found(ErrorDetector(3), lives(rng, 3000)) == []


def test_a_network_that_gets_better_is_no_change():
    rng, detector = np.random.default_rng(0), ErrorDetector(3)
    for i in range(40):
        assert found(detector, lives(rng, 50, 2.0 / (1 + i), start=50 * i)) == []


@pytest.mark.parametrize("motor", [0, 1, 2])
def test_a_reversed_motor_is_named_with_its_time(motor):
    rng, signs = np.random.default_rng(motor), np.ones(3)
    detector = used_to(rng)
    signs[motor] = -1
    change = found(detector, lives(rng, 40, signs=signs, start=300))[0]
    np.testing.assert_array_equal(change.signs, signs)
    assert 295 <= change.since <= 305


def test_larger_errors_that_nothing_explains_are_a_change_of_another_kind():
    rng = np.random.default_rng(1)
    change = found(used_to(rng), lives(rng, 60, scale=2.0, start=300))[0]
    assert change.signs is None
    assert 290 <= change.since <= 310


def test_one_hard_trial_is_no_change():
    rng = np.random.default_rng(2)
    detector = used_to(rng)
    hard = [replace(each, trial=100) for each in lives(rng, 60, scale=2.0, start=300)]
    assert found(detector, hard) == []
