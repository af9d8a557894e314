"""Two success shares of the same episodes: McNemar's exact test, and Tango's interval of their difference."""

from __future__ import annotations

from math import comb
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

HALF_STEP = 0.5
"""Half of the step by which won minus lost pairs change (Yates). Derived: without it Tango's interval holds
the truth too seldom where all differing pairs are on one side."""
HALVINGS = 60
"""Of [-1, 1] until a bound is found. Derived: to the last bit of a double."""


def mcnemar_p(won: int, lost: int) -> float:
    """Two-sided exact p of as many or more differing pairs on one side, where both sides are as likely.

    Source: Q. McNemar, Psychometrika 12 (1947); exact as the binomial sign test.

    Args:
        won: Pairs of which the second one alone succeeded.
        lost: Pairs of which the first one alone did.
    """
    pairs = won + lost
    return min(1.0, 2 * sum(comb(pairs, k) for k in range(min(won, lost) + 1)) / 2**pairs)


def score_interval(
    won: ArrayLike, lost: ArrayLike, pairs: int, confidence: float = 0.95, correction: float = HALF_STEP
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Tango's score interval of the difference of two paired shares, second minus first.

    It holds all differences that the score test does not refuse, and is defined where no pair differs.
    Source: T. Tango, Statistics in Medicine 17 (1998), equations 8 to 11.

    Args:
        won: As for `mcnemar_p`; of any shape.
        lost: Of the same shape.
        pairs: All, differing or not.
        confidence: Of the interval.
        correction: For continuity; 0 gives Tango's own interval.

    Returns:
        Lower and upper bounds, of the same shape.
    """
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    won, lost = np.asarray(won, float), np.asarray(lost, float)
    return -_upper(lost, won, pairs, z, correction), _upper(won, lost, pairs, z, correction)


def _upper(won: NDArray[Any], lost: NDArray[Any], n: int, z: float, correction: float) -> NDArray[Any]:
    """The largest difference of which won and lost pairs fall short by at most z standard deviations."""
    inside, outside = (won - lost) / n, np.ones_like(won)
    for _ in range(HALVINGS):
        difference = (inside + outside) / 2
        b = (2 * n - won + lost) * difference - won - lost
        c = lost * difference * (1 - difference)
        losing = (np.sqrt(b * b + 8 * n * c) - b) / (4 * n)  # most likely share of lost pairs
        variance = n * (2 * losing + difference * (1 - difference))
        within = n * difference - won + lost - correction <= z * np.sqrt(np.maximum(variance, 0))
        inside, outside = np.where(within, difference, inside), np.where(within, outside, difference)
    return np.asarray(inside)
