"""The median world and its interval, by what order statistics must come to."""

import numpy as np
import pytest
import scipy.stats

from experiments.statistics import Estimate, median_world, medians, most_worlds


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("worlds", [20, 21, 50])
def test_the_interval_ends_at_worlds_that_bound_the_median_in_95_of_100_samples(worlds):
    """So many of the worlds lie below the median as a coin shows heads."""
    found = median_world(rng().permutation(worlds))
    below, up_to = found.low, found.high  # worlds below the limits, as they are numbered from 0
    inside = scipy.stats.binom.cdf(up_to, worlds, 0.5) - scipy.stats.binom.cdf(below, worlds, 0.5)
    narrower = scipy.stats.binom.cdf(up_to - 1, worlds, 0.5) - scipy.stats.binom.cdf(below + 1, worlds, 0.5)
    assert narrower < 0.95 <= inside
    assert found.value == (worlds - 1) / 2


def test_a_world_that_fails_widens_nothing():
    motions = np.arange(1.0, 21)
    found = median_world(motions)
    assert median_world(np.where(motions == 20, 60, motions)) == found
    assert found.high < 16


def test_fewer_than_20_worlds_have_no_interval():
    assert not median_world(np.arange(19)).has_interval
    assert median_world(np.arange(20)).has_interval


def test_worlds_without_a_number_are_left_out():
    some = np.append(np.arange(15.0), [np.nan] * 5)
    assert median_world(some).value == 7
    assert median_world(some).has_interval
    assert not median_world(np.append([1.0, 2.0], [np.nan] * 18)).has_interval  # 3 of 4 samples
    assert np.isnan(median_world(np.full(20, np.nan)).value)


def test_curves_are_columns():
    values = rng(4).uniform(0, 1, (20, 3))
    assert medians(values)[1] == median_world(values[:, 1])
    assert medians(np.ones((20, 1))) == [Estimate(1.0, 1.0, 1.0)]


def test_most_worlds_lie_between_the_10th_and_the_90th_percentile():
    assert most_worlds(rng().permutation(21)) == (2, 18)
    assert most_worlds([3.0, 9.0, 5.0]) == (3, 9), "few worlds are all told"
