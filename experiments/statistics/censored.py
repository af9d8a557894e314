"""Motions until something is reached, where some runs end before it: right-censored times.

A run that ends at 10,000 motions without the threshold says that its time is longer than that, and no more.
"""

import warnings

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from experiments.statistics.estimate import ENOUGH_WORLDS, LEVEL, Array, Estimate


def median_time(times: Array, reached: NDArray[np.bool_]) -> Estimate:
    """The median time by Kaplan and Meier (1958); infinite where half of the worlds have not reached it.

    Its interval, where there are enough worlds, is Brookmeyer and Crowley's (1982): the times at which the
    log-log interval of the share that has not reached it holds one half.

    Args:
        times: When each world reached it, or was last looked at (n,).
        reached: Whether it did (n,).
    """
    times, reached = np.asarray(times, float), np.asarray(reached, bool)
    left = scipy.stats.ecdf(scipy.stats.CensoredData.right_censored(times, ~reached)).sf
    value = _first_half(left.quantiles, left.probabilities)
    if len(times) < ENOUGH_WORLDS:
        return Estimate(value)
    with warnings.catch_warnings():  # where all or none are left it is undefined: these are taken as they are
        warnings.simplefilter("ignore", RuntimeWarning)
        band = left.confidence_interval(LEVEL, method="log-log")
    edges = (
        np.where(np.isnan(edge.probabilities), left.probabilities, edge.probabilities)
        for edge in (band.low, band.high)
    )
    return Estimate(value, *(_first_half(left.quantiles, edge) for edge in edges))


def _first_half(times: Array, left: Array) -> float:
    """The first time after which at most half are left."""
    below = left <= 0.5 + _ROUNDING
    return float(times[below.argmax()]) if below.any() else np.inf


_ROUNDING = 1e-12
"""Of products of shares."""
