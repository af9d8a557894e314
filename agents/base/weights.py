"""Weights by which mistaken measurements count little: M-estimators (Hartley & Zisserman 2004, app. 6.8)."""

from typing import Any

import numpy as np

from .observation import Array


def huber_weights(deviations: Array, limit: float) -> Any:
    """Huber's weights: 1 up to `limit`, beyond it falling as limit / |deviation|.

    Args:
        deviations: Residuals of any shape, in standard deviations.
        limit: What counts fully.

    Returns:
        Weights of squared residuals, of the same shape, in (0, 1].
    """
    return 1 / np.maximum(1.0, np.abs(deviations) / limit)


def cauchy_weights(deviations: Array) -> Any:
    """Cauchy's weights 1 / (1 + deviation²): gross outliers hardly count at all.

    Args:
        deviations: Residuals of any shape, in units of what is just still usual: such a one counts half.

    Returns:
        Weights of squared residuals, of the same shape, in (0, 1].
    """
    return 1 / (1 + deviations * deviations)
