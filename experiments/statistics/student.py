"""Means and their changes with Student's t intervals, where the values of worlds are nearly symmetric."""

import numpy as np
import scipy.stats

from experiments.statistics.estimate import LEVEL, Array, Estimate


def mean_estimate(values: Array) -> Estimate:
    """The mean of independent values (n,), with its t interval; of one value nothing is known but itself."""
    mean = float(values.mean())
    if len(values) < 2:
        return Estimate(mean, -np.inf, np.inf)
    deviation = float(values.std(ddof=1)) / np.sqrt(len(values))
    half = float(scipy.stats.t.ppf((1 + LEVEL) / 2, len(values) - 1)) * deviation
    return Estimate(mean, mean - half, mean + half)


def relative_change(before: Array, after: Array) -> Estimate:
    """The share by which a mean changes, with its t interval.

    The change is that of a ratio of means; the interval is that of its linear part in each pair.

    Args:
        before: One value a unit (n,).
        after: The same units' values after the change (n,).
    """
    change = float(after.mean() / before.mean()) - 1
    around = mean_estimate((after - (1 + change) * before) / before.mean())
    return Estimate(change, change + around.low, change + around.high)
