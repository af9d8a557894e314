"""The median world: half of all worlds lie below.

Its interval is exact: it ends at two of the worlds that were seen, however worlds are distributed (order
statistics). So no world that was not met widens it, and one bad world in ten does not move it.
"""

from functools import cache

import numpy as np
import scipy.stats

from experiments.statistics.estimate import ENOUGH_WORLDS, LEVEL, Array, Estimate


def median_world(values: Array) -> Estimate:
    """The median over worlds, with its interval where there are enough.

    Args:
        values: One a world (n,); NaN in those that have none, which are left out.
    """
    values = np.asarray(values, float)
    found = np.sort(values[~np.isnan(values)])
    if not found.size:
        return Estimate(np.nan)
    value = float(np.median(found))
    if len(values) < ENOUGH_WORLDS:
        return Estimate(value)
    ranks = _ranks(len(found))
    return Estimate(value, *(float(found[rank]) for rank in ranks)) if ranks else Estimate(value)


def medians(values: Array) -> list[Estimate]:
    """As `median_world`, for each column of values (n, points), as a curve has them."""
    return [median_world(column) for column in np.asarray(values, float).T]


@cache
def _ranks(worlds: int) -> tuple[int, int] | None:
    """Between which of so many sorted worlds the median lies; None where that cannot be said."""
    interval = scipy.stats.quantile_test(np.arange(worlds), p=0.5).confidence_interval(LEVEL)
    return None if np.isnan(interval).any() else (int(interval.low), int(interval.high))


def most_worlds(values: Array) -> tuple[float, float]:
    """The 10th and the 90th percentile of worlds; the lowest and the highest where they are few.

    Args:
        values: One a world (n,).
    """
    low, high = (0.1, 0.9) if len(values) >= ENOUGH_WORLDS else (0.0, 1.0)
    found = np.quantile(np.asarray(values, float), (low, high))
    return float(found[0]), float(found[1])
