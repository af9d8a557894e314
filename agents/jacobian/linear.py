"""How far linear predictions of image points are off."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import lengths_px

from ..base.observation import Array, Flags

KNOWN_PX, UNKNOWN_PX, SHARE = 4.0, 6.0, 0.08
"""A linear prediction misses by the first, or by the second where it does not rest on motions like this one,
and by this share of the displacement, as standard deviations: tuned on wild worlds 3000 and up."""


def linear_deviations_px(moved: Array, known: Flags) -> Array:
    """By how much points (4,) may be off whose displacement (4, 2) was predicted by a linear function.

    Args:
        moved: The prediction, in image units.
        known: For which points (4,) it rests on motions like this one.
    """
    return np.where(known, KNOWN_PX, UNKNOWN_PX) + SHARE * lengths_px(moved)
