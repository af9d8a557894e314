"""Numbers over worlds and their intervals, by SciPy and by what they must come to."""

import numpy as np
import pytest
import scipy.stats

from experiments.statistics import (
    DRAWS,
    PSEUDO_WORLDS,
    Estimate,
    mean_estimate,
    mean_share,
    mean_shares,
    median_time,
    median_world,
    medians,
    most_worlds,
    paired_motions,
    paired_shares,
    performance_profile,
    relative_change,
    share_of_worlds,
    world_weights,
)


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


def test_numbers_of_fewer_than_20_worlds_have_no_interval():
    few, middle = mean_share(np.ones((19, 20))), median_world(np.arange(19))
    time = median_time(np.arange(19.0), np.ones(19, bool))
    assert [few.value, middle.value, time.value] == [1, 9, 9]
    assert not any(each.has_interval for each in (few, middle, time))
    assert median_world(np.arange(20)).has_interval


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
    assert medians(values)[1] == median_world(values[:, 1])
    assert medians(np.ones((20, 1))) == [Estimate(1.0, 1.0, 1.0)]


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


def test_worlds_without_a_number_are_left_out():
    some = np.append(np.arange(21.0), [np.nan] * 5)
    assert median_world(some) == median_world(some[:21])
    assert median_world(some).has_interval
    assert not median_world(some[2:]).has_interval, "19 worlds are few, however many there are without"
    assert median_world(np.append(np.arange(15.0), [np.nan] * 5)).value == 7
    assert not median_world(np.append([1.0, 2.0], [np.nan] * 18)).has_interval  # 3 of 4 samples
    assert np.isnan(median_world(np.full(20, np.nan)).value)


def test_most_worlds_lie_between_the_10th_and_the_90th_percentile():
    assert most_worlds(rng().permutation(21)) == (2, 18)
    assert most_worlds([3.0, 9.0, 5.0]) == (3, 9), "few worlds are all told"


def test_t_intervals_of_means():
    values = np.random.default_rng(0).normal(3, 2, 20)
    found = mean_estimate(values)
    assert found.value == values.mean()
    expected = scipy.stats.ttest_1samp(values, 0).confidence_interval(0.95)
    assert [found.low, found.high] == pytest.approx(list(expected))
    assert mean_estimate(np.full(5, 2.0)) == Estimate(2.0, 2.0, 2.0)
    assert mean_estimate(np.array([2.0])) == Estimate(2.0, -np.inf, np.inf)


def test_relative_changes_are_paired():
    before = np.random.default_rng(0).uniform(5, 20, 20)
    raised = relative_change(before, 1.2 * before)
    assert [raised.value, raised.low, raised.high] == pytest.approx([0.2, 0.2, 0.2])
    assert relative_change(before, before) == Estimate(0.0, 0.0, 0.0)


def _like_motions(rng):
    """20 worlds of 20 trials as skewed as first trials are; after it 30 % of the trials come out anew."""
    before = 5 + rng.gamma(2.0, 3.0, (20, 20))
    after = np.where(rng.random((20, 20)) < 0.3, 5 + rng.gamma(2.0, 3.0, (20, 20)), before)
    return before.mean(1), after.mean(1), 0.0


def _some_far_worse(rng):
    """20 worlds in a few of which the change does much harm."""
    before = 5 + rng.gamma(2.0, 3.0, 20)
    return before, 1.1 * before + rng.gamma(0.5, 2.0, 20) - 1.0, 0.1


@pytest.mark.parametrize(("drawn", "least"), [(_like_motions, 0.92), (_some_far_worse, 0.87)])
def test_relative_changes_cover_the_truth_nearly_as_often_as_they_say(drawn, least):
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(600):
        before, after, truth = drawn(rng)
        found = relative_change(before, after)
        hits += found.low <= truth <= found.high
    assert least < hits / 600 < 0.98


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
    assert paired_motions(np.append(np.full(19, 3.0), 60.0), np.full(20, 2.0)) == Estimate(1, 1, 1)


def test_worlds_with_fewer_motions_are_counted_and_equal_ones_half():
    reference = np.arange(20.0)
    found = share_of_worlds(reference - 0.1, reference)
    assert [found.value, found.high] == [1.0, 1.0]
    assert 0.7 < found.low < 0.95
    assert share_of_worlds(reference + 0.1, reference).value == 0
    assert share_of_worlds(reference, reference).value == pytest.approx(0.5)


def test_where_every_world_reaches_it_the_median_is_that_of_order_statistics():
    times = np.random.default_rng(1).exponential(1_000, 21)
    found = median_time(times, np.ones(21, bool))
    exact = median_world(times)
    assert found.value == exact.value
    place = np.searchsorted(np.sort(times), [found.low, found.high, exact.low, exact.high])
    assert np.abs(place[:2] - place[2:]).max() <= 1, "one world more or less"


def test_of_an_even_number_of_worlds_the_median_lies_amid_the_two_in_the_middle():
    times = np.random.default_rng(2).exponential(1_000, 20)
    assert median_time(times, np.ones(20, bool)).value == pytest.approx(np.median(times))
    half = np.arange(20) < 10
    assert median_time(np.where(half, 100.0, 5_000.0), half).value == np.inf, "half have not reached it"


def test_a_world_that_was_looked_at_for_a_short_time_tells_only_that():
    """Of three worlds one ends early: the others are the half of it that is left."""
    times = np.repeat([100.0, 200.0, 300.0], 10)
    reached = np.repeat([False, True, True], 10)
    assert median_time(times, reached).value == 250
    assert median_time(times, np.repeat([True, True, True], 10)).value == 200
    assert median_time(times, np.repeat([False, False, True], 10)).value == 300


def test_a_median_that_was_not_reached_is_infinite():
    reached = np.arange(20) < 9
    found = median_time(np.where(reached, 100.0, 5_000.0), reached)
    assert (found.value, found.low, found.high) == (np.inf, 100, np.inf)
    never = median_time(np.full(20, 5_000.0), np.zeros(20, bool))
    assert (never.value, never.low) == (np.inf, np.inf)


@pytest.mark.filterwarnings("error")
def test_equal_times_are_one_time():
    assert median_time(np.full(20, 50.0), np.ones(20, bool)) == Estimate(50, 50, 50)
