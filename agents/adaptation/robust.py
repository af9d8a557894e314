"""Robust statistics: a few mistaken image points hardly count."""

import numpy as np

from ..base.observation import Array

HUBER = 3.0
"""Residuals of more standard deviations count less. Choice: looser than the usual 1.345 (Huber 1981, 95 %
efficiency), as standard deviations here are themselves estimates."""
MEAN_SQUARE_MEDIAN = float(np.log(2))
"""Median of (x² + y²) / 2 for standard normal x, y. Derived: that mean is exponential with mean 1."""


def coordinate_variance(residuals: Array) -> float:
    """Variance of one coordinate of residual points (n, 2), by their median."""
    return float(np.median(np.square(residuals).mean(1)) / MEAN_SQUARE_MEDIAN)
