"""Finds the marks of a dock and a robot's own in the images of its cameras, by printed tags."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.dock_tags import prints
from calfree_gym.vision.tracking.blobs import Image
from calfree_gym.vision.tracking.outlines import Array
from calfree_gym.vision.tracking.tag_tracker import detector_of, middle, tags_in

LARGER, HALO_PX = 2, 3.0
"""Images are enlarged by the first before tags are sought in them, and sharpened: what a blur of the second,
its standard deviation in pixels, takes from them is added. Measured in wild worlds: 99 % of tags with sides
of 16 to 20 px are found, and 86 % without either."""
APART = {"minMarkerDistanceRate": 0.05, "minGroupDistance": 0.1}
"""Quadrangles are one where they are nearer than this, in perimeters and sides. Choice: the edge of a print
is 0.059 and 0.167 away from that of its tag; by OpenCV's own choice both are one, and tags are lost by it."""
WINDOW = {"relativeCornerRefinmentWinSize": 0.5}
"""In which corners are refined, in cells. Measured: marks are 0.17 px off in the median, and 0.27 by 0.3."""


class DockTracker:
    """Finds marks by tags; remembers nothing.

    An own mark is seen only where both of its tags are.

    Args:
        marks: How many the dock has, and the robot.
    """

    def __init__(self, marks: int) -> None:
        tags = prints(marks)
        of_dock = [[tag for tag in tags if tag.mark == mark and not tag.own] for mark in range(marks)]
        own = [[tag for tag in tags if tag.mark == mark and tag.own] for mark in range(marks)]
        self._marks, self._tags = of_dock + own, len(tags)

    def reset(self) -> None:
        """There is nothing to forget."""

    def copy(self) -> DockTracker:
        """Itself."""
        return self

    def find(self, image: Image) -> list[Array | None]:
        """Where the marks are seen (2,) in an image (h, w, 3), in px from its upper left corner, or None.

        First the dock's, then the own ones.
        """
        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        grey = cv2.resize(grey, None, fx=LARGER, fy=LARGER, interpolation=cv2.INTER_CUBIC)
        grey = cv2.addWeighted(grey, 2, cv2.GaussianBlur(grey, (0, 0), HALO_PX), -1, 0)
        found = tags_in(np.asarray(grey, np.uint8), _detector(self._tags))
        return [
            middle(
                np.concatenate([tag.corners for tag in tags]),
                np.concatenate([found[tag.number] for tag in tags]) / LARGER,
            )
            if all(tag.number in found for tag in tags)
            else None
            for tags in self._marks
        ]

    @staticmethod
    def track(
        trackers: Sequence[DockTracker], images: Sequence[Sequence[Image]]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """What trackers find in the images of their cameras.

        Args:
            trackers: One a robot (n,).
            images: Square ones of each camera (n, c).

        Returns:
            Image points (n, 2 M c, 2): of the dock's M marks in turn, in each camera, then of the own marks;
            and which of them are seen (n, 2 M c). Where a mark is not seen, its point is the centre.
        """
        shape = len(trackers), len(trackers[0]._marks), len(images[0])
        points, seen = np.zeros((*shape, 2)), np.zeros(shape, bool)
        for row, (tracker, of_cameras) in enumerate(zip(trackers, images, strict=True)):
            for camera, image in enumerate(of_cameras):
                for mark, point in enumerate(tracker.find(image)):
                    if point is not None:
                        points[row, mark, camera], seen[row, mark, camera] = 2 * point / len(image) - 1, True
        return points.reshape(len(trackers), -1, 2), seen.reshape(len(trackers), -1)


@cache
def _detector(tags: int) -> cv2.aruco.ArucoDetector:
    return detector_of(tags, **APART, **WINDOW)
