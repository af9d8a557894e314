"""Coloured parts: their middles and main axes, whatever their shape."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calfree_gym.vision.marks import Mark
from calfree_gym.vision.tracking.balls import BALL_SATURATION, LEAST_CONTRAST, covered, has_colour
from calfree_gym.vision.tracking.blobs import Blob
from calfree_gym.vision.tracking.opacity import opacity
from calfree_gym.vision.tracking.outline import Array

LEAST_RADIUS = 0.004
"""Of a disc as large as a part, as a share of the image's smaller side. Choice: 2 px in 512."""
BELONGS = 3.0
"""Blobs belong to one part that is hidden between them where their middles are no farther apart than this
many of their standard deviations together. Choice: halves of a bar, with half a bar between them."""


class Part(NamedTuple):
    """What is seen of a mark in an image.

    Attributes:
        area: In px².
        middle: In px from the image's upper left corner (2,).
        spread: Covariance of its pixels (2, 2), in px².
    """

    area: float
    middle: Array
    spread: Array

    @property
    def axis(self) -> Array:
        """Its main axis (2,): as long as the standard deviation along it, in px."""
        variances, axes = np.linalg.eigh(self.spread)
        return np.asarray(axes[:, 1] * np.sqrt(max(variances[1], 0.0)))

    def with_part(self, other: Part) -> Part:
        """Both together."""
        area = self.area + other.area
        share = other.area / area
        apart = other.middle - self.middle
        spread = (1 - share) * self.spread + share * other.spread
        spread = spread + share * (1 - share) * np.outer(apart, apart)
        return Part(area, self.middle + share * apart, spread)


def find_parts(blobs: list[Blob], mark: Mark, size: tuple[int, int]) -> list[Part]:
    """The parts of a mark's colour, the largest first.

    Args:
        blobs: Of that colour, roughly.
        mark: Its colour.
        size: Width and height of the image in px.
    """
    parts = (_measured(blob, mark, size) for blob in blobs)
    return sorted((part for part in parts if part is not None), key=lambda part: -part.area)


def whole(parts: list[Part]) -> Part | None:
    """The largest part with those that seem to belong to it, something before them; None of none."""
    if not parts:
        return None
    together, *others = parts
    for part in others:
        reach = np.hypot(*together.axis) + np.hypot(*part.axis)
        if np.hypot(*(part.middle - together.middle)) <= BELONGS * reach:
            together = together.with_part(part)
    return together


def _measured(blob: Blob, mark: Mark, size: tuple[int, int]) -> Part | None:
    shares, contrast = opacity(blob.window, blob.mask)
    area = float(shares.sum())
    if area < np.pi * (LEAST_RADIUS * min(size)) ** 2 or contrast < LEAST_CONTRAST:
        return None
    if not has_colour(covered(blob, shares), mark, BALL_SATURATION[0]):
        return None
    rows, columns = np.indices(shares.shape)
    middle = np.array([(shares * columns).sum(), (shares * rows).sum()]) / area
    x, y = columns - middle[0], rows - middle[1]
    xx, xy, yy = ((shares * each).sum() / area for each in (x * x, x * y, y * y))
    return Part(area, middle + np.array(blob.corner) + 0.5, np.array([[xx, xy], [xy, yy]]))
