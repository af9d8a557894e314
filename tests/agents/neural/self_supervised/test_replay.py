"""Pairs of observations of the same trial, and what becomes of them when the world changes."""

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.neural.self_supervised.inverse_model import Replay

JACOBIAN = np.array([[0.5, 0.1], [0.0, 0.4], [0.3, -0.2], [-0.1, 0.2]])


def filled(trials, each=4, capacity=1000, seed=0):
    """A replay of a linear world: the gripper's sensor vector is JACOBIAN r."""
    rng, replay = np.random.default_rng(seed), Replay(2, capacity)
    for trial in range(trials):
        object_ = rng.uniform(-1, 1, 4)
        for _ in range(each):
            add(replay, trial, rng.uniform(-1, 1, 2), object_)
    return replay


def add(replay, trial, registers, object_=(0, 0, 0, 0), visible=(True,) * 4):
    points = np.concatenate([JACOBIAN @ registers, object_]).reshape(4, 2)
    replay.add(Observation(points, np.array(visible), np.array(registers, float)), trial)


def test_all_pairs_are_of_the_same_trial_and_true():
    pairs = filled(trials=20).sample(500, np.random.default_rng(0))
    np.testing.assert_allclose(pairs.change, pairs.words @ JACOBIAN.T, atol=1e-12)
    np.testing.assert_allclose(pairs.sensors[:, :4], pairs.registers @ JACOBIAN.T, atol=1e-12)
    assert (np.abs(pairs.words).max(1) > 0).all()
    assert not pairs.doubtful.any()


def test_consecutive_pairs_go_forwards():
    replay = Replay(2, 100)
    for i in range(5):
        add(replay, 0, [0.1 * i**2, 0.0])
    pairs = replay.sample(200, np.random.default_rng(0), consecutive=True)
    steps = np.unique(np.round(pairs.words[:, 0], 9))
    np.testing.assert_allclose(steps, [0.1, 0.3, 0.5, 0.7])


def test_what_is_not_seen_or_alone_gives_no_pair():
    replay = Replay(2, 100)
    add(replay, 0, [0.1, 0.2])
    add(replay, 0, [0.3, 0.2], visible=(True, True, False, True))
    add(replay, 1, [0.1, 0.2])
    assert len(replay) == 2
    assert len(replay.sample(50, np.random.default_rng(0)).words) == 0


def test_the_oldest_are_forgotten():
    replay = filled(trials=50, each=4, capacity=30)
    assert len(replay) == 30
    assert replay.trials[0] >= 42
    assert replay.added == 200


def test_a_reversed_motor_is_mended_before_the_change_only():
    """Mended, all registers are such as the motors have them now."""
    replay = filled(trials=20)
    since = replay.added
    mirrored = JACOBIAN * [1, -1]
    for i in range(10):
        registers = np.random.default_rng(i).uniform(-1, 1, 2)
        add(replay, 20 + i // 5, [registers[0], -registers[1]])
        replay.registers[-1] = registers
    replay.reverse(np.array([1.0, -1.0]), since)
    pairs = replay.sample(1000, np.random.default_rng(0))
    np.testing.assert_allclose(pairs.change, pairs.words @ mirrored.T, atol=1e-12)


def test_what_is_doubted_is_marked_and_no_pair_spans_the_change():
    replay = filled(trials=30, each=4)
    replay.doubt(replay.added - 42)  # in the middle of a trial
    pairs = replay.sample(4000, np.random.default_rng(0))
    assert pairs.doubtful.mean() == pytest.approx(0.5, abs=0.05)
    assert np.bincount(replay.trials - replay.trials.min()).tolist()[18:22] == [4, 2, 2, 4]


def test_saved_and_restored_it_draws_alike():
    replay = filled(trials=30, capacity=60)
    replay.doubt(replay.added - 20)
    again = Replay(2, 60)
    again.restore(replay.arrays())
    for mine, its in zip(*(r.sample(100, np.random.default_rng(3)) for r in (replay, again)), strict=True):
        np.testing.assert_array_equal(mine, its)
    arrays = replay.arrays()
    for name, bad, why in (
        ("sensors", np.zeros((60, 7)), "sensors have shape"),
        ("registers", np.zeros((60, 3)), "registers have shape"),
        ("trials", np.arange(60)[::-1], "do not ascend"),
        ("doubtful", np.array(99), "doubtful hold 99; allowed: whole numbers, 0 or more, at most 60"),
        ("registers", np.full((60, 2), np.nan), "not finite"),
        ("registers", np.full((60, 2), 1e300), "registers hold"),
        ("trials", np.full(60, 1e300), "trials hold"),
        ("added", np.array(59), "added hold 59"),
    ):
        with pytest.raises(ValueError, match=why):
            again.restore({**arrays, name: bad})
