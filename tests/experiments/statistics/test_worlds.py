"""Estimands and their intervals over worlds, by SciPy and by what the weights must come to."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from experiments.statistics import (
    SHARE,
    bands,
    interquartile_mean,
    lowest_decile,
    mean,
    mean_share,
    median,
    over_worlds,
    performance_profile,
    quantile,
    worst_decile,
)
from experiments.statistics.worlds import DRAWS, PSEUDO_WORLDS, world_weights

ESTIMANDS = [mean, interquartile_mean, median, quantile(0.95), worst_decile, lowest_decile]


def rng(seed=0):
    return np.random.default_rng(seed)


def point(estimand, values):
    return estimand(np.asarray(values, float), np.full((1, len(values)), 1 / len(values)))[0]


@given(st.lists(st.integers(-50, 50), min_size=1, max_size=40))
def test_point_values_are_those_of_scipy_and_numpy(values):
    assert point(mean, values) == pytest.approx(np.mean(values))
    assert point(interquartile_mean, values) == pytest.approx(scipy.stats.trim_mean(values, 0.25))
    assert point(median, values) == pytest.approx(np.median(values))
    for share in (0.05, 0.9, 0.95):
        expected = np.quantile(values, share, method="averaged_inverted_cdf")
        assert point(quantile(share), values) == pytest.approx(expected)


def test_deciles_are_means_of_the_tenth_at_either_end():
    values = np.arange(20.0)
    assert point(worst_decile, values) == pytest.approx(18.5)
    assert point(lowest_decile, values) == pytest.approx(0.5)
    assert point(worst_decile, [3.0, 1.0, 2.0]) == 3.0
    assert point(worst_decile, np.arange(15.0)) == pytest.approx((14 + 0.5 * 13) / 1.5)


@pytest.mark.parametrize("estimand", ESTIMANDS)
def test_a_world_that_counts_twice_is_two_worlds(estimand):
    values, weights = np.array([4.0, 1.0, 9.0, 2.0]), np.array([0.2, 0.4, 0.2, 0.2])
    if estimand is interquartile_mean:
        pytest.skip("how many worlds it leaves out goes by their number")
    assert estimand(values, weights[None])[0] == pytest.approx(point(estimand, [4, 1, 1, 9, 2]))


@pytest.mark.parametrize("estimand", ESTIMANDS)
def test_no_estimand_grows_where_a_world_shrinks(estimand):
    """So that each limit is found with a world at one bound."""
    draw = rng(1)
    for _ in range(50):
        values, weights = draw.integers(0, 9, 8).astype(float), draw.dirichlet(np.ones(8), 5)
        less = values - (draw.random(8) < 0.3) * draw.random(8)
        assert (estimand(less, weights) <= estimand(values, weights) + 1e-12).all()


@pytest.mark.parametrize(("successes", "worlds"), [(0, 20), (13, 20), (19, 20), (20, 20), (4, 4), (190, 200)])
def test_worlds_that_succeed_or_fail_as_a_whole_are_proportions(successes, worlds):
    """Between Clopper and Pearson's interval (a whole world at the bound) and none at the bound."""
    found = mean_share(np.arange(worlds) < successes, rng())
    low = scipy.stats.beta.ppf(0.025, successes, worlds - successes + PSEUDO_WORLDS) if successes else 0.0
    high = 1.0
    if successes < worlds:
        high = scipy.stats.beta.ppf(0.975, successes + PSEUDO_WORLDS, worlds - successes)
    assert [found.value, found.low, found.high] == pytest.approx([successes / worlds, low, high], abs=0.01)
    exact = scipy.stats.binomtest(successes, worlds).proportion_ci(0.95, method="exact")
    assert exact.low - 0.01 <= found.low
    assert found.high <= exact.high + 0.01


def test_no_interval_of_successes_alone_is_a_point():
    found = mean_share(np.ones((20, 20)), rng())
    assert [found.value, found.high] == pytest.approx([1.0, 1.0])
    assert 0.85 < found.low < 0.92
    assert mean_share(np.ones((4, 20)), rng()).low < 0.65


def test_trials_of_one_world_are_no_more_worlds():
    """20 worlds of which two fail: the same with one trial each, or with 500."""
    worlds = np.arange(20) >= 2
    few, many = (mean_share(np.repeat(worlds[:, None], n, axis=1), rng()) for n in (1, 500))
    assert few == many
    pooled = scipy.stats.binomtest(9_000, 10_000).proportion_ci(0.95)
    assert few.high - few.low > 10 * (pooled.high - pooled.low)


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_limits_of_a_quantile_lie_within_the_exact_order_statistics(share):
    values = rng(3).gamma(2.0, 3.0, 60)
    found = over_worlds(values, quantile(share), (0.0, 100.0), rng())
    exact = scipy.stats.quantile_test(values, p=share).confidence_interval(0.95)
    assert exact.low <= found.low <= found.value <= found.high <= exact.high


@pytest.mark.parametrize("estimand", [mean, interquartile_mean])
def test_of_many_worlds_the_bound_does_not_matter(estimand):
    """Then the interval is that of SciPy's bootstrap."""
    values = rng(3).gamma(2.0, 2.0, 2_000)
    found = over_worlds(values, estimand, (0.0, values.max()), rng())
    statistic = np.mean if estimand is mean else (lambda x, axis: scipy.stats.trim_mean(x, 0.25, axis=axis))
    theirs = scipy.stats.bootstrap(
        (values,), statistic, n_resamples=1_000, method="percentile", batch=100, rng=rng(1)
    ).confidence_interval
    assert (found.low, found.high) == pytest.approx(tuple(theirs), abs=0.04)


def test_weights_are_those_of_the_bayesian_bootstrap():
    weights = world_weights(9, rng())
    assert weights.shape == (DRAWS, 10)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    expected = np.append(np.ones(9), PSEUDO_WORLDS) / (9 + PSEUDO_WORLDS)
    np.testing.assert_allclose(weights.mean(axis=0), expected, atol=0.01)


def test_bands_are_columns_and_the_same_generator_gives_the_same():
    values = rng(4).uniform(0, 1, (6, 3))
    found = bands(values, mean, SHARE, rng(5))
    assert found == bands(values, mean, SHARE, rng(5))
    assert found[1] == over_worlds(values[:, 1], mean, SHARE, rng(5))
    assert all(e.low <= e.value <= e.high for e in found)
    assert over_worlds(values[:, 0], mean, SHARE, rng(5), level=0.5).low > found[0].low


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
        over_worlds(np.array(values), mean, SHARE, rng())


def test_performance_profiles_are_shares_of_trials():
    errors = np.array([[1.0, 3.0, 5.0, 20.0], [4.0, 4.0, 1.0, 2.0]])
    found = performance_profile(errors, (2, 4, 8, 16), rng())
    assert [e.value for e in found] == [0.375, 0.75, 0.875, 0.875]
    assert all(e.low < e.value <= e.high for e in found)


def test_point_values_of_rliable():
    metrics = pytest.importorskip("rliable.metrics")
    scores = rng(2).gamma(2.0, 1.0, (20, 1))
    assert abs(metrics.aggregate_iqm(scores) - point(interquartile_mean, scores[:, 0])) < 1e-9
    assert abs(metrics.aggregate_mean(scores) - point(mean, scores[:, 0])) < 1e-9
    assert abs(metrics.aggregate_median(scores.T) - point(median, scores[:, 0])) < 1e-9
    shares = rng(2).uniform(0, 1, 20)
    assert abs(metrics.aggregate_optimality_gap(shares[:, None]) - (1 - point(mean, shares))) < 1e-9
    library = pytest.importorskip("rliable.library")
    errors = rng(2).gamma(2.0, 3.0, (20, 1))
    beyond = [library.run_score_deviation(errors, threshold) for threshold in (2.0, 4.0)]
    found = performance_profile(errors, (2, 4), rng())
    np.testing.assert_allclose([1 - e.value for e in found], beyond, atol=1e-9)
