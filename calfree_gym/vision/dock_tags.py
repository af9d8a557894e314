"""The printed tags of a robot that docks: one at each of the dock's marks, a pair about each of its own.

All stand upright, across the way on which the robot arrives. Docked, each of the dock's is in the middle of a
pair.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tags import SQUARE, dictionary

Array = NDArray[np.float64]
WIDER = 8 / 6
"""A print is so many times as wide as its tag: a cell of white is round it."""
_NEAR, _FAR = (0.10, 0.04, 0.1, -0.06), (0.13, 0.055, 0.05, 0.2)
"""Of near and of far marks, in m: the side of the dock's tag, that of own ones, and how far out and down one
of a pair is from its mark; the other is as far in and up. Choice: cameras as built see sides of 13 px or more
where trials start; docked, no print covers another. As the dock comes nearer, its marks move away from the
middle of the image: on 1 in 40 ways that end in it, an own print hides one, and on 2 in 3 where the pairs are
side by side."""
_GRID = np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)])
CORNERS, MIDDLE = [0, 2, 8, 6], 4
"""Of a grid, in ArUco's order."""
_CELL = 16
"""In pixels of a print's picture. Choice: the nearest tags have 6 in an image."""


class Print(NamedTuple):
    """A printed tag.

    Attributes:
        number: In its dictionary.
        mark: At which mark it is, of the dock or of the robot.
        own: Whether it is the robot's.
        middle: Its place about that mark (2,), to the right and down as the robot sees it, in m.
        side: Of the tag, in m.
    """

    number: int
    mark: int
    own: bool
    middle: tuple[float, float]
    side: float

    @property
    def corners(self) -> Array:
        """Those of the tag (4, 2) about the mark, to the right and down, in ArUco's order."""
        return np.asarray(self.middle + self.side / 6 * SQUARE)

    @property
    def grid(self) -> Array:
        """Nine points of it about the mark (9, 3), in the axes of a base: its corners, edges and middle."""
        right, down = (self.middle + self.side / 2 * _GRID).T
        return np.stack([np.zeros(9), -right, -down], -1)


def picture(number: int) -> NDArray[np.uint8]:
    """What a print of one of the tags looks like (h, h): black on white."""
    tag = cv2.aruco.generateImageMarker(dictionary(number + 1), number, 6 * _CELL)
    return np.asarray(np.pad(tag, _CELL, constant_values=255), np.uint8)


def prints(marks: int) -> list[Print]:
    """Those of so many marks: of each, the dock's, and then the two of the robot."""
    found = []
    for mark in range(marks):
        dock, own, out, down = _NEAR if mark < 2 else _FAR
        right = out if mark % 2 == 0 else -out
        places = ((0.0, 0.0), dock), ((right, down), own), ((-right, -down), own)
        found += [Print(3 * mark + i, mark, i > 0, *each) for i, each in enumerate(places)]
    return found
