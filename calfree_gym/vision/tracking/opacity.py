"""How much of each pixel a blob covers: closed-form matting with local colours of blob and surroundings."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tracking.colours import Image

BAND = 2.0
"""Half the width, in px, of the band along a blob's outline whose pixels may be mixed. Choice: the reach of a
blur of 1 px, the usual one."""
NEIGHBOURHOOD = 9
"""Width, in px, of the square in which local colours are averaged. Choice: from the middle of the band it
reaches two pixels beyond."""
NOISE_VARIANCE = 4.0
"""Of a channel. Choice: a noise of 2 levels, so that flat drawings have a covariance too."""
SETTLED = 0.15
"""Pixels that a second look may change, per root of the blob's area. Choice: one in 25 along the outline.
A blob whose outline blur or bright surroundings have moved is looked at once more."""

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
    colours = np.ones((*mask.shape, 4), np.float32)
    colours[..., :3] = window
    shares, contrast = _once(colours, mask)
    again = (shares > 0.5).astype(np.uint8)
    changed = cv2.countNonZero(again ^ mask)
    if contrast == 0 or changed < SETTLED * cv2.countNonZero(mask) ** 0.5:
        return shares, contrast
    return _once(colours, again)


def _once(colours: NDArray[np.float32], mask: Image) -> tuple[Opacity, float]:
    """As `opacity`, of colours (h, w, 4) whose last channel is 1."""
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    reach = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
    least = min(BAND + 0.5, 0.6 * float(depth.max()))
    inside = cv2.inRange(depth, least, np.inf)
    outside = cv2.inRange(reach, BAND + 0.5, np.inf)
    band = np.flatnonzero(cv2.bitwise_or(inside, outside) == 0)
    if least == 0 or not outside.any() or not len(band):
        return (inside > 0).astype(np.float32), 0.0
    front, behind = _local_sums(colours, inside), _local_sums(colours, outside)
    flat = colours.reshape(-1, 4)
    near_out = np.flatnonzero(cv2.inRange(reach, BAND + 0.5, NEIGHBOURHOOD / 2 + BAND))
    near_in = np.flatnonzero(cv2.inRange(depth, least, NEIGHBOURHOOD / 2 + BAND))
    spread = np.concatenate([_differences(flat, behind, near_out), _differences(flat, front, near_in)])
    covariance = spread.T @ spread / len(spread) + NOISE_VARIANCE * np.eye(3, dtype=np.float32)
    beyond = _differences(flat, behind, band)
    step = beyond - _differences(flat, front, band)
    weighted = step @ np.linalg.inv(covariance)
    power = np.einsum("ij,ij->i", weighted, step)
    part = np.einsum("ij,ij->i", weighted, beyond) / np.maximum(power, 1e-6)
    shares = np.multiply(inside, np.float32(1 / 255))
    shares.reshape(-1)[band] = part.clip(0, 1)
    return shares, float(np.sqrt(np.median(power)))


def _local_sums(colours: NDArray[np.float32], where: Image) -> NDArray[np.float32]:
    """Sums (h * w, 4), weighted alike, of the colours `where` (h, w) around each pixel."""
    chosen = cv2.copyTo(colours, where)
    weak = 1e-4 * np.array(cv2.mean(colours, where), np.float32)
    size = (NEIGHBOURHOOD, NEIGHBOURHOOD)
    return (cv2.blur(chosen, size, borderType=cv2.BORDER_CONSTANT) + weak).reshape(-1, 4)


def _differences(
    colours: NDArray[np.float32], sums: NDArray[np.float32], pixels: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Colours (n, 3) of some pixels less the local means that `_local_sums` leads to."""
    near = sums.take(pixels, 0)
    return colours.take(pixels, 0)[:, :3] - near[:, :3] / near[:, 3:]
