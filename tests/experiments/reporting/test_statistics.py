import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from experiments.reporting.statistics import bootstrap_band, interquartile_mean, wilson_interval


def test_interquartile_mean_leaves_out_a_quarter_at_each_end():
    assert interquartile_mean(np.array([100.0, 1, 2, 3, -100, 4, 5, 6])) == 3.5
    assert interquartile_mean(np.array([1.0, 3.0])) == 2.0
    np.testing.assert_allclose(interquartile_mean(np.arange(8.0).reshape(4, 2)), [3, 4])


@pytest.mark.parametrize("runs", [1, 2, 3, 4, 7, 20])
def test_interquartile_mean_is_the_trimmed_mean(runs):
    values = np.random.default_rng(runs).normal(size=(runs, 3))
    np.testing.assert_allclose(interquartile_mean(values), scipy.stats.trim_mean(values, 0.25), atol=1e-14)


@pytest.mark.parametrize("level", [0.5, 0.95])
@pytest.mark.parametrize("statistic", [np.mean, np.median, np.std], ids=lambda s: s.__name__)
def test_bootstrap_is_the_percentile_bootstrap(level, statistic):
    """Two bootstraps of 20,000 resamples differ by their resamples only."""
    values = np.random.default_rng(3).gamma(2, size=25)
    mine = bootstrap_band(
        values, lambda runs: statistic(runs, axis=0), np.random.default_rng(0), level, resamples=20_000
    )
    theirs = scipy.stats.bootstrap(
        (values,),
        statistic,
        confidence_level=level,
        n_resamples=20_000,
        method="percentile",
        rng=np.random.default_rng(1),
    ).confidence_interval
    np.testing.assert_allclose(mine, theirs, atol=0.03)


def test_bootstrap_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(300):
        low, high = bootstrap_band(rng.normal(size=(30, 1)), _mean, rng, resamples=400)
        hits += low[0] <= 0 <= high[0]
    assert 0.89 < hits / 300 < 0.98


def test_bootstrap_is_reproducible_and_keeps_shape():
    values = np.random.default_rng(1).normal(size=(5, 7))
    first = bootstrap_band(values, _mean, np.random.default_rng(2))
    second = bootstrap_band(values, _mean, np.random.default_rng(2))
    np.testing.assert_array_equal(first, second)
    assert first[0].shape == (7,)
    assert (first[0] <= values.mean(0)).all()
    assert (values.mean(0) <= first[1]).all()


def _mean(runs):
    return runs.mean(axis=0)


def test_wilson_interval_of_published_examples():
    assert wilson_interval(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)  # Newcombe 1998
    assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.floats(0.5, 0.999))
def test_wilson_interval_is_that_of_scipy(counts, level):
    theirs = scipy.stats.binomtest(*counts).proportion_ci(level, method="wilson")
    assert wilson_interval(*counts, level) == pytest.approx(tuple(theirs), abs=1e-9)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_holds_the_proportion(counts):
    low, high = wilson_interval(*counts)
    assert -1e-12 <= low <= counts[0] / counts[1] + 1e-12
    assert counts[0] / counts[1] - 1e-12 <= high <= 1 + 1e-12


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 2)])
def test_wilson_interval_of_nonsense(successes, trials):
    with pytest.raises(ValueError, match=f"found {successes} successes in {trials} trials"):
        wilson_interval(successes, trials)
