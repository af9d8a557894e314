"""The outline of a blob, between pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tracking.opacity import Opacity

Array = NDArray[np.float64]

RAYS = 48
"""Directions in which the outline is sought. Choice: one for every 4 px of the largest ball's outline."""
STEP = 0.5
"""Between samples along a ray, in px. Choice: an edge is at least 1 px wide."""
_ANGLES = np.arange(RAYS) * (2 * np.pi / RAYS)
_RAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)


def outline(shares: Opacity, centre: Array) -> Array:
    """Where rays from `centre` (2,) last leave a blob: points (RAYS, 2) in px, pixel centres whole."""
    radii = np.arange(0.0, np.hypot(*shares.shape), STEP)
    where = (centre + radii[:, None, None] * _RAYS).astype(np.float32)
    along = cv2.remap(shares, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    last = len(radii) - 1 - (along[::-1] >= 0.5).argmax(0)
    last = np.where((along >= 0.5).any(0), last, 0).clip(0, len(radii) - 2)
    rays = np.arange(RAYS)
    here, beyond = along[last, rays], along[last + 1, rays]
    part = ((here - 0.5) / np.maximum(here - beyond, 1e-6)).clip(0, 1)
    return centre + ((last + part) * STEP)[:, None] * _RAYS
