"""Motions until something is reached, where some runs end before it: right-censored times.

A run that ends at 10,000 motions without the threshold says that its time is longer than that, and no more.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from experiments.statistics.estimate import LEVEL, Array, Estimate
from experiments.statistics.worlds import world_weights


def survival(times: Array, reached: NDArray[np.bool_], weights: Array) -> tuple[Array, Array]:
    """Kaplan and Meier's (1958) share of worlds that have not reached it after each time.

    Args:
        times: When each world reached it, or was last looked at (n,).
        reached: Whether it did (n,).
        weights: Of the worlds (draws, n), each row summing to 1.

    Returns:
        The times in order (n,), and the share after each (draws, n).
    """
    order = np.lexsort((~reached, times))  # of equal times, those that reached it come first
    weights = weights[:, order]
    at_risk = np.cumsum(weights[:, ::-1], axis=1)[:, ::-1]
    left = np.divide(
        at_risk - weights * reached[order], at_risk, out=np.ones_like(weights), where=at_risk > 0
    )
    return times[order], np.cumprod(np.clip(left, 0.0, 1.0), axis=1)


def median_time(times: Array, reached: NDArray[np.bool_], rng: np.random.Generator) -> Estimate:
    """The median time with its interval; infinite where half of the worlds have not reached it.

    Args:
        times: When each world reached it, or was last looked at (n,).
        reached: Whether it did (n,).
        rng: Draws the weights.
    """
    return _interval(times, reached, rng, _median)


def restricted_mean_time(
    times: Array, reached: NDArray[np.bool_], horizon: float, rng: np.random.Generator
) -> Estimate:
    """The mean of the times with its interval, those after the horizon counting as it.

    Args:
        times: When each world reached it, or was last looked at (n,).
        reached: Whether it did (n,).
        horizon: Up to which the area below the curve of survival is taken.
        rng: Draws the weights.
    """
    return _interval(times, reached, rng, partial(_area, horizon=horizon))


_Of = Callable[[Array, NDArray[np.bool_], Array], Array]


def _median(times: Array, reached: NDArray[np.bool_], weights: Array) -> Array:
    times, left = survival(times, reached, weights)
    below = left <= 0.5 + 1e-12
    return np.where(below.any(axis=1), times[below.argmax(axis=1)], np.inf)


def _area(times: Array, reached: NDArray[np.bool_], weights: Array, horizon: float) -> Array:
    times, left = survival(times, reached, weights)
    edges = np.clip(np.concatenate([[0.0], times, [horizon]]), 0.0, horizon)
    return np.asarray(np.concatenate([np.ones((len(left), 1)), left], axis=1) @ np.diff(edges))


def _interval(times: Array, reached: NDArray[np.bool_], rng: np.random.Generator, estimand: _Of) -> Estimate:
    """Half a world reaches it at once for the lower limit, and never for the upper one; see `worlds`."""
    times, reached = np.asarray(times, float), np.asarray(reached, bool)
    weights = world_weights(len(times), rng)
    (value,) = estimand(times, reached, np.full((1, len(times)), 1 / len(times)))
    tail = (1 - LEVEL) / 2
    at_once = estimand(np.append(times, 0.0), np.append(reached, True), weights)
    never = estimand(np.append(times, np.inf), np.append(reached, False), weights)
    low = np.quantile(at_once, tail, method="inverted_cdf")  # no mean of a time and infinity
    high = np.quantile(never, 1 - tail, method="inverted_cdf")
    return Estimate(float(value), min(float(low), float(value)), max(float(high), float(value)))
