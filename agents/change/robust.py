"""Weights that let a mistaken point count little."""

import numpy as np

from agents.agent import Array

HUBER = 3.0
"""Residuals of more standard deviations count less."""


def huber(deviations: Array) -> Array:
    """Huber's weights of residuals in standard deviations."""
    return np.asarray(1 / np.maximum(1.0, np.abs(deviations) / HUBER))
