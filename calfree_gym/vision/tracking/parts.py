"""The coloured parts of a gripper, and what is completed of those that are partly hidden."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from calfree_gym.vision.marks import Mark
from calfree_gym.vision.tracking.balls import BALL_SATURATION, LEAST_CONTRAST, covered, have_colours
from calfree_gym.vision.tracking.blobs import Blob, Image
from calfree_gym.vision.tracking.outlines import Array, Circle, Opacity, fit_circles, opacity, outline

LEAST_RADIUS = 0.004
"""Of a disc as large as a part, as a share of the image's smaller side. Choice: 2 px in 512."""
BELONGS = 3.0
"""Blobs belong to one part that is hidden between them where their middles are no farther apart than this
many of their standard deviations together. Choice: halves of a bar, with half a bar between them."""


class MarkPart(NamedTuple):
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
    def of(cls, corner: Array, shares: Opacity) -> MarkPart:
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
        points = outline(self.shares, self.middle - corner)
        (found,) = fit_circles(points[None], (self.middle - centre)[None], np.array([largest]))
        return replace(found, centre=found.centre + corner)

    def with_part(self, other: MarkPart) -> MarkPart:
        """Both together."""
        return MarkPart.of(*self.union(other))

    def union(self, other: MarkPart) -> tuple[Array, Opacity]:
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


def find_parts(blobs: list[Blob], mark: Mark) -> list[MarkPart]:
    """The parts of a mark's colour, the largest first.

    Args:
        blobs: Of that colour, roughly.
        mark: Its colour.
    """
    parts = (_measured(blob, mark) for blob in blobs)
    return sorted((part for part in parts if part is not None), key=lambda part: -part.area)


def whole(parts: list[MarkPart]) -> MarkPart | None:
    """The largest part with those that seem to belong to it, something before them; None of none."""
    if not parts:
        return None
    together, *others = parts
    for part in others:
        reach = np.hypot(*together.axis) + np.hypot(*part.axis)
        if np.hypot(*(part.middle - together.middle)) <= BELONGS * reach:
            together = together.with_part(part)
    return together


def _measured(blob: Blob, mark: Mark) -> MarkPart | None:
    shares, contrast = opacity(blob.window, blob.mask)
    area = float(shares.sum())
    if area < np.pi * (LEAST_RADIUS * min(blob.image_size)) ** 2 or contrast < LEAST_CONTRAST:
        return None
    if not have_colours(covered(blob, shares)[None], [mark], BALL_SATURATION[0])[0]:
        return None
    return MarkPart.of(np.array(blob.corner, float), shares)


BEYOND = 0.05
"""What is seen lies still if no larger share of it lies where it was not before. Choice: noise of edges."""
ROUND = 0.65
"""Share of the outline of a thing seen whole that is a circle's, if it is round. Measured in images: spheres
have 0.77 or more, bars, boxes and cylinders 0.57 or less."""
GROWN = 1.5
"""A round thing is seen no larger than so many times as large as before. Choice: a circle through a short arc
may be of any size."""
TURNS = np.radians(np.arange(-12.0, 13.0, 4.0))
"""By so much (rad) a thing may have turned in the image since the last one. Choice: cameras that turn with
the arm, in a motion near the object."""
HIDDEN = 0.03
"""A thing is seen whole if no larger share of it is hidden. Choice: seams."""
UNEXPLAINED = 0.3
"""A thing of which a larger share is seen elsewhere, or is missing, shows another side. Choice."""


def completed(seen: MarkPart, before: MarkPart | None, centre: Array, hiders: Image) -> MarkPart:
    """A thing of which this is seen now, and perhaps more was seen before.

    Where all that is seen was there before, it lies still, and what is missing is hidden. Otherwise it has
    moved, or shows another side: its middle is that of the circle if it is round; else it is laid over what
    is seen of it.

    Args:
        seen: Now.
        before: The same thing as it was known in the last image; None at first, where it is seen whole.
        centre: Of the image (2,), in px.
        hiders: 1 where something may hide it, of the whole image (h, w), and 0 elsewhere.
    """
    if before is None:
        circle = seen.circle(centre, float(np.hypot(*seen.shares.shape)))
        return seen._replace(radius=circle.radius if circle.roundness > ROUND else 0.0)
    _, together = before.union(seen)
    if together.sum() - before.area <= BEYOND * seen.area:
        return before
    if not before.radius:
        return _registered(seen, before, hiders)
    circle = seen.circle(centre, GROWN * before.radius)
    return seen._replace(middle=circle.centre, radius=circle.radius)


def _registered(seen: MarkPart, before: MarkPart, hiders: Image) -> MarkPart:
    """The thing as it was before, where it is now; `seen` where that is all of it, or shows another side.

    Of all shifts and turns, that which leaves least of what is seen, and of what should be, unexplained.

    Args:
        seen: All that is seen of it now.
        before: The same thing as it was known in the last image.
        hiders: 1 where something may hide it, of the whole image (h, w), and 0 elsewhere.
    """
    size, (height, width) = max(before.shares.shape), seen.shares.shape
    x, y = seen.corner.astype(int)
    padded = np.pad(1 - hiders, size)
    shown: Opacity = padded[y : y + height + 2 * size, x : x + width + 2 * size].astype(np.float32)
    if shown.all():
        return seen
    prices = shown.copy()
    prices[size:-size, size:-size] -= 2 * seen.shares
    found = []
    for turn in TURNS:
        shares = _turned(before, float(turn), size)
        costs = np.asarray(cv2.matchTemplate(prices, shares, cv2.TM_CCORR), np.float32)
        least, _, place, _ = cv2.minMaxLoc(costs)
        found.append((least, place, shares, costs))
    least, (across, down), shares, costs = min(found, key=lambda each: each[0])
    part = MarkPart.of(seen.corner - size + np.array([across, down]), shares)
    there = shown[down : down + shares.shape[0], across : across + shares.shape[1]]
    hidden = 1 - float((shares * there).sum()) / part.area
    if hidden <= HIDDEN or least + seen.area > UNEXPLAINED * part.area:
        return seen
    return part._replace(middle=part.middle + _between_pixels(costs, across, down))


def _turned(part: MarkPart, turn: float, size: int) -> Opacity:
    """The shares of a part, turned (rad) about its middle, in the middle of a window (size, size)."""
    middle = part.middle - part.corner - 0.5
    matrix = np.array(cv2.getRotationMatrix2D(middle.tolist(), np.degrees(turn), 1.0))
    matrix[:, 2] = matrix[:, 2] + size / 2 - middle
    return np.asarray(cv2.warpAffine(part.shares, matrix, (size + 1, size + 1)), np.float32)


def _between_pixels(costs: Opacity, x: int, y: int) -> Array:
    """How far beyond a pixel (2,) the least of a parabola through its neighbours' costs is, each way."""
    offsets = np.zeros(2)
    for axis, line in enumerate((costs[y, x - 1 : x + 2], costs[y - 1 : y + 2, x])):
        if len(line) == 3 and (curved := line[0] - 2 * line[1] + line[2]) > 0:
            offsets[axis] = np.clip((line[0] - line[2]) / (2 * curved), -0.5, 0.5)
    return offsets
