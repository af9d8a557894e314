"""A thing of which something hides a part: what was seen of it before tells where its middle is."""

from __future__ import annotations

import cv2
import numpy as np

from calfree_gym.vision.tracking.colours import Image
from calfree_gym.vision.tracking.opacity import Opacity
from calfree_gym.vision.tracking.outline import Array
from calfree_gym.vision.tracking.parts import Part

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


def completed(seen: Part, before: Part | None, centre: Array, hiders: Image) -> Part:
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


def _registered(seen: Part, before: Part, hiders: Image) -> Part:
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
    part = Part.of(seen.corner - size + np.array([across, down]), shares)
    there = shown[down : down + shares.shape[0], across : across + shares.shape[1]]
    hidden = 1 - float((shares * there).sum()) / part.area
    if hidden <= HIDDEN or least + seen.area > UNEXPLAINED * part.area:
        return seen
    return part._replace(middle=part.middle + _between_pixels(costs, across, down))


def _turned(part: Part, turn: float, size: int) -> Opacity:
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
