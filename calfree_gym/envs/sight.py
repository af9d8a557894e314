"""What the cameras of N arms deliver: image points by projection, image points found in images, or images."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.rendering.stereo_images import StereoImages
from calfree_gym.streams import MotionNumbers
from calfree_gym.vision.image_formation import ImageFormation
from calfree_gym.vision.marks import Marks
from calfree_gym.vision.tracker import StereoTracker

if TYPE_CHECKING:
    from calfree_gym.envs.stereo_arms import StereoArms

SMALLEST, LARGEST = 16, 1024
"""Pixels of an image."""


class Images:
    """Images (N, 2, size, size, ...) of all rows, rendered where a row has moved since.

    Makes its GL context when the first image is rendered.

    Attributes:
        now: As last looked.

    Args:
        arms: The arms.
        size: Width and height of an image in pixels.
        depth: Whether they show depths in m rather than colours.
    """

    def __init__(self, arms: StereoArms, size: int, depth: bool = False) -> None:
        self._arms, self._depth = arms, depth
        shape = (arms.rows, 2, size, size)
        self.now: NDArray[Any] = np.zeros(shape, np.float32) if depth else np.zeros((*shape, 3), np.uint8)
        self._size = size
        self._renderer: StereoImages | None = None
        self._sensors = ImageFormation(size)
        self._places = MotionNumbers(arms.rows, "image_noise", (2, 2), normal=False)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._places.seed(row, seed)

    def look(self, rows: NDArray[np.intp]) -> None:
        """Renders what these rows see now."""
        arms = self._arms
        if self._renderer is None:
            self._renderer = StereoImages(arms.simulation, arms.robot.rig, self._size)
        places = self._places.at(arms.trials, arms.motions_of_trial)
        for row in rows.tolist():
            world = arms.world(row)
            if self._depth:
                self.now[row] = self._renderer.depths(row, world)
                continue
            for camera, light in enumerate(self._renderer.colours(row, world)):
                self.now[row, camera] = self._sensors.image(light, world, camera, places[row, camera])

    def close(self) -> None:
        """Frees the GL context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class TrackedPoints:
    """Image points that trackers find in the images of all rows.

    Attributes:
        points: As last seen (N, 4, 2).
        visible: Which the last images showed (N, 4).

    Args:
        rows: N.
    """

    SIZE = IMAGE_SIZE
    """Width and height of the images in pixels."""

    def __init__(self, rows: int) -> None:
        self._trackers = [StereoTracker(Marks()) for _ in range(rows)]
        self.points = np.zeros((rows, 4, 2))
        self.visible = np.zeros((rows, 4), bool)

    def begin_trial(self, rows: NDArray[np.intp]) -> None:
        """Forgets what was tracked before."""
        for row in rows.tolist():
            self._trackers[row].reset()

    def look(self, rows: NDArray[np.intp], images: NDArray[np.uint8]) -> tuple[Array, Flags]:
        """Points (N, 4, 2) and flags (N, 4), after new images of some rows."""
        for row in rows.tolist():
            self.points[row], self.visible[row] = self._trackers[row](*images[row])
        return self.points, self.visible
