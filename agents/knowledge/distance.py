"""How far keys are apart, in the worse image."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, camera_lengths_px


def squared_px(differences: Array) -> Array:
    """Square of the longer of the two image distances (...,), in px², of sensor differences (..., 4).

    Where there are six, the last two are of directions in both images: a quarter turn is like half an image.
    """
    squares = np.square(camera_lengths_px(differences[..., :4]))
    if differences.shape[-1] > 4:
        squares = squares + np.square(differences[..., 4:] / IMAGE_UNIT)
    return np.asarray(squares.max(-1))
