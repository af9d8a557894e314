"""What the cameras of N arms deliver: points by projection, points found in images, or images."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.rendering.stereo_images import StereoImages
from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.streams import MotionNumbers
from calfree_gym.vision.image_formation import ImageFormation
from calfree_gym.vision.measurement import MeasurementModel
from calfree_gym.world import World

if TYPE_CHECKING:
    from calfree_gym.envs.arms.base import Arms
    from calfree_gym.vision.tracking.grasp_tracker import GraspTracker
    from calfree_gym.vision.tracking.tracker import StereoTracker

    Tracker = StereoTracker | GraspTracker

SHADOWS_FROM = 256
"""Images of fewer pixels have no shadows. Choice: those who ask for small images want them fast, and shadows
take two thirds of their time."""

Seen = tuple[NDArray[Any], ...]
"""Points (N, p, 2), which of them were seen (N, p), and images, where they are delivered."""


class Sight:
    """Points where projection puts them, with noise, outliers and dropout.

    Attributes:
        renders: Whether images are rendered.
        finds: Whether points are found in images, whatever projection and rays say.
        images: Those of all rows (N, 2, size, size, ...), where they are delivered; else none.

    Args:
        arms: The arms.
    """

    renders: ClassVar[bool] = False
    finds: ClassVar[bool] = False
    state_names: ClassVar[tuple[str, ...]] = ()
    images: tuple[NDArray[Any], ...] = ()

    def __init__(self, arms: Arms) -> None:
        self._arms = arms
        self._measurement = MeasurementModel(*arms.visible.shape)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._measurement.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the measurement of `world`."""
        self._measurement.set_world(row, world)

    def begin_trial(self, rows: NDArray[np.intp]) -> None:
        """These rows are at home."""

    def look(self, true: Array, visible: Flags, moved: Flags) -> Seen:
        """What is seen.

        Args:
            true: Where noise-free cameras would see the points (N, p, 2).
            visible: Which of them are in the images, and nothing hides them (N, p).
            moved: Where anything has moved (N,) since the last look.
        """
        arms = self._arms
        return self._measurement.measure(true, visible, arms.trials, arms.motions_of_trial)

    def close(self) -> None:
        """Frees what renders."""


class RenderedSight(Sight):
    """Images of all rows, besides the true points.

    Makes its GL context when the first image is rendered.

    Args:
        arms: The arms.
        size: Width and height of an image in pixels.
        depth: Whether they show depths in m rather than colours.
    """

    renders = True
    state_names: ClassVar[tuple[str, ...]] = ("_images",)

    def __init__(self, arms: Arms, size: int, depth: bool = False) -> None:
        super().__init__(arms)
        self._size, self._depth = size, depth
        shape = (arms.rows, 2, size, size)
        self._images: NDArray[Any] = np.zeros(shape, np.float32) if depth else np.zeros((*shape, 3), np.uint8)
        self.images = (self._images,)
        self._sensors = ImageFormation(size)
        self._places = MotionNumbers(arms.rows, "image_noise", (2, 2), normal=False)
        self._renderer: StereoImages | None = None

    def seed(self, row: int, seed: int) -> None:
        """See `Sight`."""
        self._places.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """See `Sight`: points are those of the images, and have no noise of their own."""

    def look(self, true: Array, visible: Flags, moved: Flags) -> Seen:
        """See `Sight`."""
        self._render(np.flatnonzero(moved))
        return true, visible, *self.images

    def _render(self, rows: NDArray[np.intp]) -> None:
        arms = self._arms
        if self._renderer is None:
            shadows = self._size >= SHADOWS_FROM
            self._renderer = StereoImages(arms.simulation, arms.robot.rig, self._size, shadows)
        places = self._places.at(arms.trials, arms.motions_of_trial)
        for row in rows.tolist():
            world = arms.world(row)
            if self._depth:
                self._images[row] = self._renderer.depths(row, world)
                continue
            for camera, light in enumerate(self._renderer.colours(row, world)):
                self._images[row, camera] = self._sensors.image(light, world, camera, places[row, camera])

    def close(self) -> None:
        """See `Sight`."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class TrackedSight(RenderedSight):
    """Points that a tracker finds in images of 512 x 512 pixels.

    Args:
        arms: The arms.
        tracker: Makes a tracker for one row.
    """

    finds = True
    state_names = ("_trackers", "_points", "_visible")

    def __init__(self, arms: Arms, tracker: Callable[[], Tracker]) -> None:
        super().__init__(arms, IMAGE_SIZE)
        self.images = ()
        self._trackers = [tracker() for _ in range(arms.rows)]
        self._points, self._visible = np.zeros_like(arms.points), np.zeros_like(arms.visible)

    def begin_trial(self, rows: NDArray[np.intp]) -> None:
        """See `Sight`: what was tracked before is forgotten."""
        for row in rows.tolist():
            self._trackers[row].reset()

    def look(self, true: Array, visible: Flags, moved: Flags) -> Seen:
        """See `Sight`."""
        rows = np.flatnonzero(moved)
        self._render(rows)
        for row in rows.tolist():
            self._points[row], self._visible[row] = self._trackers[row](*self._images[row])
        return self._points.copy(), self._visible.copy()


def sight_of(arms: Arms, observation: str, image_size: int, tracker: Callable[[], Tracker]) -> Sight:
    """What an observation of that name needs; `tracker` makes one for what is to be found in images."""
    if observation == "points":
        return Sight(arms)
    if observation == "vision":
        return TrackedSight(arms, tracker)
    return RenderedSight(arms, image_size, depth=observation == "depth")
