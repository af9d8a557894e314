import numpy as np
import pytest

from experiments.statistics import median_world, paired_motions, paired_shares, share_of_worlds


def rng(seed=0):
    return np.random.default_rng(seed)


def test_what_worlds_have_in_common_is_taken_out():
    of_world = 30 * rng(1).random(20)
    values, reference = of_world + rng(2).random(20), of_world
    found = paired_motions(values, reference)
    assert found == median_world(values - reference)
    assert 0 < found.low < found.high < 1, "although worlds differ by far more"


def test_equal_shares_in_few_worlds_do_not_prove_equality():
    found = paired_shares(np.ones(20), np.ones(20))
    assert found.value == 0
    assert -0.15 < found.low < -0.08
    assert 0.08 < found.high < 0.15


def test_a_bad_world_for_one_agent_alone_moves_no_median():
    found = paired_motions(np.append(np.full(19, 3.0), 60.0), np.full(20, 2.0))
    assert (found.value, found.low, found.high) == (1, 1, 1)


def test_worlds_with_fewer_motions_are_counted_and_equal_ones_half():
    reference = np.arange(20.0)
    found = share_of_worlds(reference - 0.1, reference)
    assert [found.value, found.high] == [1.0, 1.0]
    assert 0.7 < found.low < 0.95
    assert share_of_worlds(reference + 0.1, reference).value == 0
    assert share_of_worlds(reference, reference).value == pytest.approx(0.5)
