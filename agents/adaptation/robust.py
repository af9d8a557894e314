"""Weights that let a mistaken point count little."""

import numpy as np

from agents.base.observation import Array

HUBER = 3.0
"""Residuals of more standard deviations count less."""


RAYLEIGH_MEDIAN = np.log(2)
"""Median of the mean of two squared standard normal deviates."""


def typical(residuals: Array) -> float:
    """Variance of a coordinate, by the median of residual points (n, 2): a few mistaken ones do not count."""
    return float(np.median(np.square(residuals).mean(1)) / RAYLEIGH_MEDIAN)


def huber(deviations: Array) -> Array:
    """Huber's weights of residuals in standard deviations."""
    return np.asarray(1 / np.maximum(1.0, np.abs(deviations) / HUBER))
