"""What is estimated of a population of worlds, from values that have weights.

Each estimand is a function of values (n,), one a world, and weights (draws, n) that sum to 1 in each draw; it
returns one number a draw. Each grows with every value: a worse world never makes a better number.
"""

from collections.abc import Callable

import numpy as np

from experiments.statistics.estimate import Array

Estimand = Callable[[Array, Array], Array]


def mean(values: Array, weights: Array) -> Array:
    """The mean over worlds."""
    return np.asarray(weights @ values)


def interquartile_mean(values: Array, weights: Array) -> Array:
    """The mean of the middle half (Agarwal et al. 2021, "rliable").

    With n equal weights it is SciPy's `trim_mean(values, 0.25)`: n // 4 worlds are left out at each end.
    """
    out = (len(values) // 4) / len(values)
    return _mean_between(values, weights, out, 1 - out)


def worst_decile(values: Array, weights: Array) -> Array:
    """The mean of the highest tenth, as of motions; fewer than ten worlds have the highest one."""
    return _mean_between(values, weights, 0.9, 1.0)


def lowest_decile(values: Array, weights: Array) -> Array:
    """The mean of the lowest tenth, which is the worst one of shares of success."""
    return _mean_between(values, weights, 0.0, 0.1)


def median(values: Array, weights: Array) -> Array:
    """Half of the worlds lie below."""
    return quantile(0.5)(values, weights)


def quantile(share: float) -> Estimand:
    """The estimand below which this share of the worlds lies, as NumPy's "averaged_inverted_cdf"."""

    def estimand(values: Array, weights: Array) -> Array:
        order = np.argsort(values)
        below, found = np.cumsum(weights[:, order], axis=1), values[order]
        first = np.argmax(below >= share - _ROUNDING, axis=1)
        after = np.minimum(np.argmax(below > share + _ROUNDING, axis=1), len(values) - 1)
        after = np.maximum(first, after)  # the last world, where nothing lies above
        return np.asarray((found[first] + found[after]) / 2)

    return estimand


_ROUNDING = 1e-12
"""Of sums of weights."""


def _mean_between(values: Array, weights: Array, low: float, high: float) -> Array:
    """The mean of the worlds between two shares of the sorted worlds."""
    order = np.argsort(values)
    above = np.cumsum(weights[:, order], axis=1)
    below = above - weights[:, order]
    inside = np.clip(np.minimum(above, high) - np.maximum(below, low), 0.0, None)
    return np.asarray(inside @ values[order] / inside.sum(axis=1))
