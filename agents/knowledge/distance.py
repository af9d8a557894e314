"""How far sensor vectors are apart, in the worse image."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array, camera_lengths_px


def squared_px(differences: Array) -> Array:
    """Square of the longer of the two image distances (...,), in px², of sensor differences (..., 4)."""
    return np.asarray(np.square(camera_lengths_px(differences)).max(-1))
