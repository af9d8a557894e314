"""Kaplan and Meier's estimate by SciPy's."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from experiments.statistics import median_time, restricted_mean_time
from experiments.statistics.censored import survival


def rng(seed=0):
    return np.random.default_rng(seed)


def scipys(times, reached):
    data = scipy.stats.CensoredData.right_censored(times, ~reached)
    return scipy.stats.ecdf(data).sf


@given(st.lists(st.tuples(st.integers(1, 12), st.booleans()), min_size=1, max_size=30))
def test_survival_is_that_of_scipy(runs):
    times, reached = (np.array(column) for column in zip(*runs, strict=True))
    theirs = scipys(times, reached)
    at, left = survival(times.astype(float), reached, np.full((1, len(times)), 1 / len(times)))
    for time in np.unique(times):
        assert left[0, at <= time][-1] == pytest.approx(theirs.evaluate(time), abs=1e-12)


def censored(seed, worlds=40):
    draw = rng(seed)
    times, ends = draw.exponential(1_000, worlds), draw.uniform(500, 3_000, worlds)
    return np.minimum(times, ends), times <= ends


def test_the_median_is_the_first_time_at_which_half_are_left():
    times, reached = censored(1)
    theirs = scipys(times, reached)
    expected = theirs.quantiles[np.argmax(theirs.probabilities <= 0.5)]
    found = median_time(times, reached, rng())
    assert found.value == expected
    assert found.low < expected < found.high


@pytest.mark.filterwarnings("ignore:The confidence interval is undefined")
def test_the_interval_of_the_median_is_near_that_of_brookmeyer_and_crowley():
    """Where SciPy's log-log interval of survival crosses one half (1982)."""
    times, reached = censored(2, worlds=200)
    theirs = scipys(times, reached)
    band = theirs.confidence_interval(0.95, method="log-log")
    low, high = (each.quantiles[np.argmax(each.probabilities <= 0.5)] for each in (band.low, band.high))
    found = median_time(times, reached, rng())
    assert [found.low, found.high] == pytest.approx([low, high], rel=0.12)


def test_a_median_that_was_not_reached_is_infinite():
    times, reached = np.full(20, 5_000.0), np.arange(20) < 9
    found = median_time(np.where(reached, 100.0, times), reached, rng())
    assert (found.value, found.high) == (np.inf, np.inf)
    assert found.low == 100


def test_the_restricted_mean_is_the_area_below_the_curve():
    times, reached = censored(3)
    theirs = scipys(times, reached)
    grid = np.linspace(0, 2_000, 200_001)
    found = restricted_mean_time(times, reached, 2_000.0, rng())
    assert found.value == pytest.approx(np.mean(theirs.evaluate(grid)) * 2_000, rel=1e-4)
    assert found.low < found.value < found.high
    everything = restricted_mean_time(np.array([10.0, 20.0]), np.array([True, True]), 100.0, rng())
    assert everything.value == 15
