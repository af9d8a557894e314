import numpy as np
import pytest
from scipy import stats

from experiments.statistics import Estimate, mean_estimate, relative_change


def test_t_intervals_of_means():
    values = np.random.default_rng(0).normal(3, 2, 20)
    found = mean_estimate(values)
    assert found.value == values.mean()
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
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
