"""What trackers of two cameras share: images that are checked, frozen cameras, points that stay."""

from __future__ import annotations

import copy
import warnings
import zlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS
from calfree_gym.vision.tracking.blobs import Image
from calfree_gym.vision.tracking.outlines import Array

Pair = tuple[Image, Image]
"""What the left and the right camera see."""
Found = tuple[Array | None, Array | None]
"""The gripper point and the object point (2,), in px from the upper left corner of the upper left pixel; None
where a point is not seen."""
LEAST_SIZE = 16
"""Width and height of an image in px. Choice: a ball of the least radius is a tenth of it."""


class FrozenCameras:
    """Tells which cameras have frozen, and warns once when one does.

    A live camera has noise. So one has frozen whose image is the last one, to the byte, although motors have
    moved; and it has until another image comes.
    """

    def __init__(self) -> None:
        self._last: list[int | None] = [None for _ in CAMERAS]
        self._frozen = [False for _ in CAMERAS]

    def __call__(self, images: tuple[Image, ...], moved: bool) -> tuple[bool, ...]:
        """Whether each camera has frozen.

        Args:
            images: One a camera.
            moved: Whether motors have moved since the last ones.
        """
        for camera, image in enumerate(images):
            last, self._last[camera] = self._last[camera], zlib.crc32(image.tobytes())
            before, again = self._frozen[camera], last == self._last[camera]
            self._frozen[camera] = again and (before or bool(moved))
            if self._frozen[camera] and not before:
                warnings.warn(
                    f"the {CAMERAS[camera]} camera has frozen: motors have moved, and its image is the last "
                    "one to the byte. Its points count as not seen until another image comes",
                    stacklevel=3,
                )
        return tuple(self._frozen)


class PointTracker(ABC):
    """Finds the gripper point and the object point in pairs of images, by marks that a subclass knows."""

    def __init__(self) -> None:
        self._cameras = FrozenCameras()
        self.reset()

    def reset(self) -> None:
        """Forgets what was seen: what was never seen stands at the centre. A frozen camera stays frozen."""
        self._points = np.zeros((4, 2))

    def copy(self) -> Self:
        """One that remembers the same, and goes on by itself."""
        other = copy.copy(self)
        other._cameras = copy.deepcopy(self._cameras)
        other._points = self._points.copy()
        return other

    def __call__(self, left: Image, right: Image, moved: bool = False) -> tuple[Array, NDArray[np.bool_]]:
        """The points in a pair of images, and which of them are seen.

        Args:
            left: RGB (h, w, 3), uint8, of any size. OpenCV gives BGR: turn its last axis round.
            right: As `left`; it may have another size.
            moved: Whether motors have moved since the last images. A live camera has noise: one whose image
                is the last one, to the byte, has frozen then: its points are not seen, and a warning says so.

        Returns:
            Image points (4, 2): gripper left and right, object left and right; and flags (4,). They are
            (x, y) from the middle, x right and y down, in halves of the image's longer side. A point that is
            not seen stands where it was seen last, at first at the centre.

        Raises:
            ValueError: An image is no such array.
        """
        check_images(left, right)
        frozen = self._cameras((left, right), moved)
        looks = enumerate(zip((left, right), frozen, strict=True))
        found = [(None, None) if gone else self._find(camera, image) for camera, (image, gone) in looks]
        return self._placed((left, right), found)

    @abstractmethod
    def _find(self, camera: int, image: Image) -> Found:
        """What is found in an image (h, w, 3) of a camera, 0 or 1."""

    def _placed(self, pair: Pair, found: Sequence[Found]) -> tuple[Array, NDArray[np.bool_]]:
        """What the call returns, where so much was found in both images."""
        visible = np.zeros(4, bool)
        for camera, (image, points) in enumerate(zip(pair, found, strict=True)):
            for row, point in zip((camera, 2 + camera), points, strict=True):
                if point is not None:
                    height, width = image.shape[:2]
                    self._points[row] = (2 * point / [width, height] - 1) * proportions(image)
                    visible[row] = True
        return self._points.copy(), visible


def proportions(image: Image) -> Array:
    """Width and height (2,) of an image, by the longer of both: so lengths are alike along both axes."""
    height, width = image.shape[:2]
    return np.array([width, height]) / max(width, height)


def check_images(left: Any, right: Any) -> None:
    """Raises ValueError where an image is no uint8 array (h, w, 3), or too small."""
    for name, image in zip(CAMERAS, (left, right), strict=True):
        _check_image(name, image)


def _check_image(name: str, image: Any) -> None:
    if not isinstance(image, np.ndarray):
        raise ValueError(f"the {name} image is a {type(image).__name__}; it must be a uint8 array (h, w, 3)")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(
            f"the {name} image has shape {image.shape} and type {image.dtype}; it must be (h, w, 3), uint8"
        )
    if min(image.shape[:2]) < LEAST_SIZE:
        raise ValueError(
            f"the {name} image is {image.shape[1]} × {image.shape[0]} px; it must be {LEAST_SIZE} × "
            f"{LEAST_SIZE} or more"
        )
