"""How much of each pixel a blob covers: closed-form matting with local colours of blob and surroundings."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.colours import Image

BAND = 2.0
"""Half the width, in px, of the band along a blob's outline whose pixels may be mixed. Choice: the reach of a
blur of 1 px, the usual one."""
NEIGHBOURHOOD = 9
"""Width, in px, of the square in which local colours are averaged. Choice: from the middle of the band it
reaches two pixels beyond."""
NOISE_VARIANCE = 4.0
"""Of a channel. Choice: a noise of 2 levels, so that flat drawings have a covariance too."""

Opacity = NDArray[np.float32]
"""Share of each pixel that the blob covers, (h, w)."""


def opacity(window: Image, mask: Image) -> tuple[Opacity, float]:
    """Which share of each pixel a blob covers, and how clearly it stands out.

    A pixel p of the band between a blob and its surroundings mixes the colours F and B that these have
    nearby. Its share is that of F that explains p best, (F-B)' S (p-B) / (F-B)' S (F-B), where S is the
    inverse covariance of the colours about F and B: what varies anyway, such as brightness, counts little.

    Args:
        window: Image around the blob (h, w, 3).
        mask: 1 within the blob, roughly, and 0 elsewhere (h, w).

    Returns:
        The shares; and the distance between F and B in standard deviations, in the median.
    """
    colours = window.astype(np.float32)
    shares, contrast = _once(colours, mask)
    return _once(colours, (shares > 0.5).astype(np.uint8)) if contrast > 0 else (shares, contrast)


def _once(colours: NDArray[np.float32], mask: Image) -> tuple[Opacity, float]:
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    reach = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
    deepest = float(depth.max())
    inside = depth >= min(BAND + 0.5, 0.6 * deepest)
    outside = reach >= BAND + 0.5
    shares = inside.astype(np.float32)
    if deepest == 0 or not outside.any():
        return shares, 0.0
    front, behind = _local_mean(colours, inside), _local_mean(colours, outside)
    spread = np.concatenate(
        [(colours - behind)[outside & (reach < 8)], (colours - front)[inside & (depth < 6)]]
    )
    covariance = spread.T @ spread / len(spread) + NOISE_VARIANCE * np.eye(3, dtype=np.float32)
    band = ~(inside | outside)
    step = (front - behind)[band]
    weighted = step @ np.linalg.inv(covariance)
    power = (weighted * step).sum(-1)
    shares[band] = ((weighted * (colours - behind)[band]).sum(-1) / np.maximum(power, 1e-6)).clip(0, 1)
    return shares, float(np.sqrt(np.median(power)))


def _local_mean(colours: NDArray[np.float32], where: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Mean colours (h, w, 3) of the pixels `where` (h, w) around each pixel."""
    weights = where.astype(np.float32)
    size = (NEIGHBOURHOOD, NEIGHBOURHOOD)
    sums = cv2.blur(colours * weights[..., None], size, borderType=cv2.BORDER_CONSTANT)
    counts = cv2.blur(weights, size, borderType=cv2.BORDER_CONSTANT)
    mean = colours[where].mean(0)
    return np.where(counts[..., None] > 1e-3, sums / np.maximum(counts, 1e-3)[..., None], mean)
