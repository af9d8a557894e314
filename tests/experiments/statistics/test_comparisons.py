import numpy as np
import pytest
import scipy.stats

from experiments.statistics import (
    paired_difference,
    paired_shares,
    probability_of_improvement,
    probability_of_improvement_paired,
)


def rng(seed=0):
    return np.random.default_rng(seed)


def drawn(seed, worlds=20, ties=True):
    values = rng(seed).gamma(2.0, 3.0, worlds)
    return values.round() if ties else values


def test_paired_differences_have_the_interval_of_the_paired_t_test():
    values, reference = drawn(1), drawn(2)
    found = paired_difference(values, reference)
    expected = scipy.stats.ttest_rel(values, reference).confidence_interval(0.95)
    assert found.value == pytest.approx(np.mean(values - reference))
    assert [found.low, found.high] == pytest.approx(list(expected))


def test_equal_shares_in_few_worlds_do_not_prove_equality():
    found = paired_shares(np.ones(20), np.ones(20), rng())
    assert found.value == 0
    assert -0.15 < found.low < -0.08
    assert 0.08 < found.high < 0.15


def test_the_unpaired_probability_of_improvement_is_mann_whitneys():
    values, reference = drawn(1), drawn(2, worlds=15)
    found = probability_of_improvement(values, reference, rng())
    pairs = [(x > y) + 0.5 * (x == y) for x in values for y in reference]
    assert abs(found.value - np.mean(pairs)) < 1e-9
    statistic = scipy.stats.mannwhitneyu(values, reference).statistic
    assert abs(found.value - statistic / (20 * 15)) < 1e-9
    assert found.low < found.value < found.high


def test_the_paired_one_compares_within_worlds():
    reference = np.arange(10.0)
    found = probability_of_improvement_paired(reference + 0.1, reference, rng())
    assert [found.value, found.high] == pytest.approx([1.0, 1.0])
    assert 0.7 < found.low < 0.95
    assert probability_of_improvement(reference + 0.1, reference, rng()).value == pytest.approx(0.55)
    assert probability_of_improvement_paired(reference, reference, rng()).value == pytest.approx(0.5)


def test_the_probability_of_improvement_is_rliables():
    metrics = pytest.importorskip("rliable.metrics")
    values, reference = drawn(1), drawn(2, worlds=15)
    theirs = metrics.probability_of_improvement(values[:, None], reference[:, None])
    assert abs(probability_of_improvement(values, reference, rng()).value - theirs) < 1e-9
