"""Shares of trials and their intervals over worlds, by SciPy and by what the weights must come to."""

import numpy as np
import pytest
import scipy.stats

from experiments.statistics import mean_share, mean_shares, performance_profile
from experiments.statistics.worlds import DRAWS, PSEUDO_WORLDS, world_weights


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize(("successes", "worlds"), [(0, 20), (13, 20), (19, 20), (20, 20), (190, 200)])
def test_worlds_that_succeed_or_fail_as_a_whole_are_proportions(successes, worlds):
    """Between Clopper and Pearson's interval (a whole world at the bound) and none at the bound."""
    found = mean_share(np.arange(worlds) < successes)
    low = scipy.stats.beta.ppf(0.025, successes, worlds - successes + PSEUDO_WORLDS) if successes else 0.0
    high = 1.0
    if successes < worlds:
        high = scipy.stats.beta.ppf(0.975, successes + PSEUDO_WORLDS, worlds - successes)
    assert [found.value, found.low, found.high] == pytest.approx([successes / worlds, low, high], abs=0.01)
    exact = scipy.stats.binomtest(successes, worlds).proportion_ci(0.95, method="exact")
    assert exact.low - 0.01 <= found.low
    assert found.high <= exact.high + 0.01


def test_no_interval_of_successes_alone_is_a_point():
    found = mean_share(np.ones((20, 20)))
    assert [found.value, found.high] == [1, 1]
    assert 0.85 < found.low < 0.92


def test_fewer_than_20_worlds_have_no_interval():
    few = mean_share(np.ones((19, 20)))
    assert few.value == 1
    assert not few.has_interval


def test_trials_of_one_world_are_no_more_worlds():
    """20 worlds of which two fail: the same with one trial each, or with 500."""
    worlds = np.arange(20) >= 2
    few, many = (mean_share(np.repeat(worlds[:, None], n, axis=1)) for n in (1, 500))
    assert few == many
    pooled = scipy.stats.binomtest(9_000, 10_000).proportion_ci(0.95)
    assert few.high - few.low > 10 * (pooled.high - pooled.low)


def test_of_many_worlds_the_bound_does_not_matter():
    """Then the interval is that of SciPy's bootstrap."""
    values = rng(3).beta(2.0, 2.0, 2_000)
    found = mean_share(values)
    theirs = scipy.stats.bootstrap(
        (values,), np.mean, n_resamples=1_000, method="percentile", batch=100, rng=rng(1)
    ).confidence_interval
    assert (found.low, found.high) == pytest.approx(tuple(theirs), abs=0.002)


def test_weights_are_those_of_the_bayesian_bootstrap():
    weights = world_weights(9)
    assert weights.shape == (DRAWS, 10)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    expected = np.append(np.ones(9), PSEUDO_WORLDS) / (9 + PSEUDO_WORLDS)
    np.testing.assert_allclose(weights.mean(axis=0), expected, atol=0.01)


def test_curves_are_columns():
    values = rng(4).uniform(0, 1, (20, 3))
    found = mean_shares(values)
    alone = mean_share(values[:, 1])
    assert [found[1].low, found[1].high] == pytest.approx([alone.low, alone.high])
    assert all(e.low <= e.value <= e.high for e in found)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([], "found no world"),
        ([0.5, 1.5], "found 0.5 to 1.5 in 2 worlds; allowed: one world or more, from 0 to 1"),
        ([np.nan], "found nan"),
    ],
)
def test_values_outside_the_bounds(values, said):
    with pytest.raises(ValueError, match=said):
        mean_shares(np.reshape(values, (-1, 1)))


def test_performance_profiles_are_shares_of_trials():
    errors = np.tile([[1.0, 3.0, 5.0, 20.0], [4.0, 4.0, 1.0, 2.0]], (10, 1))
    found = performance_profile(errors, (2, 4, 8, 16))
    assert [e.value for e in found] == [0.375, 0.75, 0.875, 0.875]
    assert all(e.low < e.value <= e.high for e in found)
