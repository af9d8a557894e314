"""McNemar's exact test and Tango's interval: against SciPy, published numbers, and the likelihood itself."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import binomtest

from calfree_gym.perturb.paired_shares import mcnemar_p, score_interval


def test_p_is_that_of_the_binomial_test():
    for won in range(12):
        for lost in range(40):
            if won + lost:
                assert mcnemar_p(won, lost) == pytest.approx(binomtest(won, won + lost).pvalue, rel=1e-9)
    assert mcnemar_p(0, 0) == 1.0


@pytest.mark.parametrize(
    ("won", "lost", "pairs", "low", "high"),
    [
        (1, 7, 21, -0.517, -0.026),  # Bentur et al. 2009
        (6, 16, 161, -0.1240, -0.0054),  # Cavo et al. 2012
    ],
)
def test_intervals_that_were_published(won, lost, pairs, low, high):
    """In Fagerland, Lydersen and Laake, Statistical Analysis of Contingency Tables (2017), chapter 8."""
    digits = 3 if pairs == 21 else 4
    found = score_interval(won, lost, pairs, correction=0)
    np.testing.assert_allclose(found, (low, high), atol=0.51 * 10**-digits)


@pytest.mark.parametrize(
    "counts", [(0, 1, 44), (12, 2, 50), (0, 9, 30), (3, 3, 30), (25, 4, 30), (0, 96, 100)]
)
def test_bounds_are_where_the_score_of_the_most_likely_shares_is_z(counts):
    """Shares that are most likely at a difference, by maximising the likelihood numerically."""
    won, lost, pairs = counts

    def score(difference):
        def unlikely(losing):
            shares = np.array([losing + difference, losing, 1 - 2 * losing - difference])
            return -np.array([won, lost, pairs - won - lost]) @ np.log(np.maximum(shares, 1e-300))

        least, most = max(0, -difference), (1 - difference) / 2
        losing = minimize_scalar(unlikely, bounds=(least, most), options={"xatol": 1e-12}).x
        variance = pairs * (2 * losing + difference - difference**2)
        return (won - lost - pairs * difference) / np.sqrt(variance)

    middle, z = (won - lost) / pairs, 1.959963984540054
    low, high = score_interval(*counts, correction=0)
    if middle > -1:
        assert brentq(lambda d: score(d) - z, -1 + 1e-9, middle - 1e-9) == pytest.approx(float(low), abs=1e-5)
    if middle < 1:
        assert brentq(lambda d: score(d) + z, middle + 1e-9, 1 - 1e-9) == pytest.approx(float(high), abs=1e-5)


def test_edges():
    low, high = score_interval([0, 30, 0], [0, 0, 30], 30, correction=0)
    z2 = 1.959963984540054**2
    np.testing.assert_allclose(high, [z2 / (30 + z2), 1, -low[1]])
    np.testing.assert_allclose(low, [-high[0], 30 / (30 + z2) * 2 - 1, -1], atol=1e-9)
