"""How far sensor vectors are apart, in pixels of the worse image."""

from __future__ import annotations

import numpy as np

from agents.base.observation import Array
from calfree_gym.image import IMAGE_UNIT


def squared_px(apart: Array) -> Array:
    """Square of the longer of the two image distances (...,), in px², of differences of sensors (..., 4)."""
    squares = np.square(apart)
    return np.maximum(squares[..., 0] + squares[..., 1], squares[..., 2] + squares[..., 3]) / IMAGE_UNIT**2
