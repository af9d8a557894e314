"""Rewards, as all tasks have them, from image distances and success."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import lengths

Floats = NDArray[Any]


def image_distances(achieved: Floats, desired: Floats) -> Floats:
    """Distances (..., 2) in image units, per camera, between sensor vectors (..., 4)."""
    d = achieved - desired
    return lengths(d.reshape(*d.shape[:-1], 2, 2))


def sparse_reward(distances: Floats, success: Floats) -> Floats:
    """0 at success and -1 anywhere else (...)."""
    return success - 1.0


def dense_reward(distances: Floats, success: Floats) -> Floats:
    """Minus the mean of both distances (...), in image units."""
    return -0.5 * (distances[..., 0] + distances[..., 1]).astype(np.float64)
