"""Coloured parts: their middles and main axes, whatever their shape."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calfree_gym.vision.marks import Mark
from calfree_gym.vision.tracking.balls import BALL_SATURATION, LEAST_CONTRAST, covered, has_colour
from calfree_gym.vision.tracking.blobs import Blob
from calfree_gym.vision.tracking.circles import Circle, fit_circle
from calfree_gym.vision.tracking.opacity import Opacity, opacity
from calfree_gym.vision.tracking.outline import Array, outline

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
        corner: Left and upper border of its window (2,), in px from the image's.
        shares: Which share of each pixel of its window it covers (h, w).
        radius: Of a round thing, in px; zero of any other.
    """

    area: float
    middle: Array
    spread: Array
    corner: Array
    shares: Opacity
    radius: float = 0.0

    @classmethod
    def of(cls, corner: Array, shares: Opacity) -> Part:
        """The part that covers these shares of pixels."""
        area = float(shares.sum())
        rows, columns = np.indices(shares.shape)
        middle = np.array([(shares * columns).sum(), (shares * rows).sum()]) / area
        x, y = columns - middle[0], rows - middle[1]
        xx, xy, yy = ((shares * each).sum() / area for each in (x * x, x * y, y * y))
        return cls(area, middle + corner + 0.5, np.array([[xx, xy], [xy, yy]]), corner, shares)

    @property
    def axis(self) -> Array:
        """Its main axis (2,), to the right or down: as long as the standard deviation along it, in px."""
        variances, axes = np.linalg.eigh(self.spread)
        axis = axes[:, 1] * np.sign(axes[:, 1] @ [2, 1])
        return np.asarray(axis * np.sqrt(max(variances[1], 0.0)))

    def circle(self, centre: Array, largest: float) -> Circle:
        """That of its outline: nothing else hides more than it shows.

        Args:
            centre: Of the image (2,), in px.
            largest: Largest radius, in px.
        """
        corner = self.corner + 0.5
        found = fit_circle(outline(self.shares, self.middle - corner), self.middle - centre, largest)
        return replace(found, centre=found.centre + corner)

    def with_part(self, other: Part) -> Part:
        """Both together."""
        return Part.of(*self.union(other))

    def union(self, other: Part) -> tuple[Array, Opacity]:
        """The window of both: its left and upper border (2,), and which share of each pixel they cover."""
        corners = np.stack([self.corner, other.corner])
        ends = corners + [each.shares.shape[::-1] for each in (self, other)]
        corner = corners.min(0)
        width, height = (ends.max(0) - corner).astype(int)
        shares = np.zeros((height, width), np.float32)
        for part in (self, other):
            x, y = (part.corner - corner).astype(int)
            window = shares[y : y + part.shares.shape[0], x : x + part.shares.shape[1]]
            np.maximum(window, part.shares, out=window)
        return corner, shares


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
    return Part.of(np.array(blob.corner, float), shares)
