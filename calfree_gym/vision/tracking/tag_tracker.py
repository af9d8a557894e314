"""Finds the gripper and the object in stereo images, by printed tags."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tags import GRIPPER, OBJECT, PAIR, SQUARE, TAGS, dictionary
from calfree_gym.vision.tracking.blobs import Image
from calfree_gym.vision.tracking.outlines import Array
from calfree_gym.vision.tracking.stereo import PointTracker

MOST_BENT = 0.1
"""How far (RMS) corners may be from where those of one flat print would be, in sides of a tag. Choice: the
worst of 120 drawn prints with tags of 37 px has 0.03."""
PIXELS_PER_CELL = 8
"""By which the bits of a tag are read. Measured on drawn prints with tags of 28 and 20 px: 100 and 77 % of
grippers are found, and with OpenCV's 4 px 93 and 60 %."""


class TagTracker(PointTracker):
    """Finds the gripper point and the object point in pairs of images, by tags that `print_tags` prints.

    A pinhole camera sees a flat print by a homography; that of the corners of its tags tells where its middle
    is seen. By one tag alone the gripper point would be off ten times as far: it is seen only where both tags
    are. A tag that an image shows twice counts as not seen.
    """

    def _find(self, camera: int, image: Image) -> tuple[Array | None, Array | None]:
        tags = find_tags(image)
        pair = [tags[number] for number in GRIPPER if number in tags]
        gripper = middle(PAIR, np.concatenate(pair)) if len(pair) == len(GRIPPER) else None
        return gripper, middle(SQUARE, tags[OBJECT]) if OBJECT in tags else None


def find_tags(image: Image) -> dict[int, Array]:
    """Corners (4, 2) of each tag that an image (h, w, 3) shows once, by its number.

    In ArUco's order, in px from the upper left corner of the upper left pixel.
    """
    grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    return tags_in(np.asarray(grey, np.uint8), _detector())


def tags_in(grey: NDArray[np.uint8], detector: cv2.aruco.ArucoDetector) -> dict[int, Array]:
    """As `find_tags`, by a detector, in an image of one channel (h, w)."""
    corners, found, _ = detector.detectMarkers(grey)
    numbers = [] if found is None else [int(number) for number in found.ravel()]
    half = 0.5  # OpenCV's zero is the middle of a pixel
    return {
        number: each[0].astype(float) + half
        for number, each in zip(numbers, corners, strict=True)
        if numbers.count(number) == 1
    }


def middle(corners: Array, seen: Array) -> Array | None:
    """Where the origin of a flat print is seen (2,); None where it is no such print.

    Args:
        corners: Of its tags, on the print (n, 2), about its origin.
        seen: Where they are seen (n, 2), by a pinhole camera.
    """
    homography, _ = cv2.findHomography(corners, seen)
    fitted = cv2.perspectiveTransform(np.stack([corners, np.zeros_like(corners)]), homography)
    sides = (seen - np.roll(seen.reshape(-1, 4, 2), 1, axis=1).reshape(-1, 2)) ** 2
    if ((fitted[0] - seen) ** 2).sum() > MOST_BENT**2 * sides.sum():
        return None
    return np.asarray(fitted[1, 0])


def detector_of(count: int, **settings: float) -> cv2.aruco.ArucoDetector:
    """Finds the first so many tags of the dictionary; settings are OpenCV's."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.perspectiveRemovePixelPerCell = PIXELS_PER_CELL
    for name, value in settings.items():
        setattr(parameters, name, value)
    return cv2.aruco.ArucoDetector(dictionary(count), parameters)


@cache
def _detector() -> cv2.aruco.ArucoDetector:
    return detector_of(TAGS)
