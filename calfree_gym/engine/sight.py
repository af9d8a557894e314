"""What the cameras of N arms deliver: points by projection, points found in images, or images."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import MINUS_ONE, ONE, Array, Flags
from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT
from calfree_gym.pool import OfWorlds
from calfree_gym.rendering.stereo_images import Exposure, StereoImages
from calfree_gym.robot.arms.robot import Rig
from calfree_gym.robot.simulation import Simulation
from calfree_gym.streams import MotionNumbers
from calfree_gym.vision.image_formation import ImageFormation
from calfree_gym.world.value import MAX_LATENCY, World

Counts = NDArray[np.int64]


class MeasurementModel(OfWorlds):
    """The vision systems of N worlds, one row each: true image points in, measured ones out.

    Args:
        rows: N.
        points: p, of both images together.
    """

    of_world: ClassVar[tuple[str, ...]] = ("_noise", "_outliers", "_dropout")

    def __init__(self, rows: int, points: int = 4) -> None:
        self._noise = np.zeros((rows, points, 2))
        self._outliers = np.zeros((rows, 1))
        self._dropout = np.zeros((rows, 1))
        self._noise_numbers = MotionNumbers(rows, "noise", (points, 2), normal=True)
        self._outlier_numbers = MotionNumbers(rows, "outliers", (points, 3), normal=False)
        self._dropout_numbers = MotionNumbers(rows, "dropout", (points,), normal=False)
        self._any_outliers = self._any_dropout = False

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        for numbers in (self._noise_numbers, self._outlier_numbers, self._dropout_numbers):
            numbers.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` noise, outliers and dropout of `world`."""
        self._noise[row] = world.point_noise * IMAGE_UNIT
        self._outliers[row] = world.point_outliers
        self._dropout[row] = world.point_dropout
        self.note_worlds()

    def note_worlds(self) -> None:
        """See `OfWorlds`."""
        self._any_outliers = bool(self._outliers.any())
        self._any_dropout = bool(self._dropout.any())

    def measure(self, true: Array, visible: Flags, trials: Counts, motions: Counts) -> tuple[Array, Flags]:
        """Measured points (N, p, 2) and flags (N, p) of one observation, from the true ones.

        An outlier stands anywhere in the image. A point that drops out is not seen this time.
        """
        measured = true + self._noise * self._noise_numbers.at(trials, motions)
        measured = np.minimum(np.maximum(measured, MINUS_ONE), ONE)  # faster than clip
        if self._any_outliers:
            drawn = self._outlier_numbers.at(trials, motions)
            outlier = drawn[:, :, 0] < self._outliers
            measured = np.where(outlier[:, :, None], 2 * drawn[:, :, 1:] - 1, measured)
        if self._any_dropout:
            visible = visible & (self._dropout_numbers.at(trials, motions) >= self._dropout)
        return measured, visible


class ObservationQueues(OfWorlds):
    """Queues of observations of N worlds, one row each.

    The queue of a new trial holds the observation at home. Where latency begins in mid-trial, the queue holds
    the observation of that time.

    Args:
        rows: N.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_queues", "_beginning")
    of_world: ClassVar[tuple[str, ...]] = ("_latency",)

    def __init__(self, rows: int) -> None:
        self._latency, self._late = np.zeros(rows, np.int64), False
        self._beginning = np.zeros(rows, bool)
        self._queues: list[dict[int, tuple[NDArray[Any], ...]]] = [{} for _ in range(rows)]

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the latency of `world`."""
        if not world.latency:
            self._queues[row].clear()
        self._beginning[row] |= world.latency > 0 and self._latency[row] == 0
        self._latency[row] = world.latency
        self.note_worlds()

    def note_worlds(self) -> None:
        """See `OfWorlds`."""
        self._late = bool(self._latency.any())

    def deliver(self, motions: NDArray[np.int64], *observed: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """What comes out of the queues, as many motions late as each world is.

        Args:
            motions: Of the trial (N,).
            observed: Arrays (N, ...).
        """
        if not self._late:
            return observed
        late = tuple(each.copy() for each in observed)
        for row, (queue, motion) in enumerate(zip(self._queues, motions.tolist(), strict=True)):
            if self._beginning[row] or motion == 0:
                queue.clear()
            queue[motion] = tuple(each[row].copy() for each in observed)
            queue.pop(motion - MAX_LATENCY - 1, None)
            due = queue[max(motion - int(self._latency[row]), min(queue))]
            for each, delivered in zip(late, due, strict=True):
                each[row] = delivered
        self._beginning[:] = False
        return late


class Tracker(Protocol):
    """Finds points in the images of one arm, see `calfree_gym.vision`."""

    def reset(self) -> None:
        """Forgets what was tracked before."""

    def copy(self) -> Self:
        """One that remembers the same, and goes on by itself."""

    @staticmethod
    def track(trackers: Any, images: Any, /) -> tuple[Array, Flags]:
        """Points (n, p, 2), and which were seen (n, p), in images of all cameras (n,), by a tracker each."""


SHADOWS_FROM = 256
"""Images of fewer pixels have no shadows. Choice: those who ask for small images want them fast, and shadows
take two thirds of their time."""

TOGETHER = 8
"""Rows whose images are developed, and looked at, together: while the next ones are rendered. Choice."""

Seen = tuple[NDArray[Any], ...]
"""Points (N, p, 2), which of them were seen (N, p), and images, where they are delivered."""


class Sight(OfWorlds):
    """Points where projection puts them, with noise, outliers and dropout.

    Attributes:
        renders: Whether images are rendered.
        finds: Whether points are found in images, whatever projection and rays say.
        images: Those of all rows (N, c, size, size, ...), where they are delivered; else none.
        measurement: Of points where projection puts them.

    Args:
        rows: N.
        points: p.
    """

    renders: ClassVar[bool] = False
    finds: ClassVar[bool] = False
    state_names: ClassVar[tuple[str, ...]] = ()
    images: tuple[NDArray[Any], ...] = ()

    def __init__(self, rows: int, points: int) -> None:
        self.measurement = MeasurementModel(rows, points)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self.measurement.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the measurement of `world`."""
        self.measurement.set_world(row, world)

    def begin_trial(self, rows: NDArray[np.intp]) -> None:
        """These rows are at home."""

    def look(self, true: Array, visible: Flags, moved: Flags, trials: Counts, motions: Counts) -> Seen:
        """What is seen.

        Args:
            true: Where noise-free cameras would see the points (N, p, 2).
            visible: Which of them are in the images, and nothing hides them (N, p).
            moved: Where anything has moved (N,) since the last look.
            trials: Begun (N,).
            motions: Of these trials (N,).
        """
        return self.measurement.measure(true, visible, trials, motions)

    def close(self) -> None:
        """Frees what renders."""


class RenderedSight(Sight):
    """Images of all rows, besides the true points.

    Makes its GL context when the first image is rendered.

    Args:
        simulation: The N arms.
        rig: Where the lamp is to light up the room.
        points: p.
        size: Width and height of an image in pixels.
        depth: Whether they show depths in m rather than colours.
    """

    renders = True
    state_names: ClassVar[tuple[str, ...]] = ("_images",)
    of_world: ClassVar[tuple[str, ...]] = ("_worlds",)

    def __init__(self, simulation: Simulation, rig: Rig, points: int, size: int, depth: bool = False) -> None:
        rows = simulation.rows
        super().__init__(rows, points)
        self._simulation, self._rig, self._size, self._depth = simulation, rig, size, depth
        cameras = len(simulation.cameras)
        shape = (rows, cameras, size, size)
        self._images: NDArray[Any] = np.zeros(shape, np.float32) if depth else np.zeros((*shape, 3), np.uint8)
        self.images = (self._images,)
        self._worlds = np.full(rows, None)
        self._sensors = ImageFormation(size)
        self._places = MotionNumbers(rows, "image_noise", (cameras, 2), normal=False)
        self._renderer: StereoImages | None = None

    def seed(self, row: int, seed: int) -> None:
        """See `Sight`."""
        self._places.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """See `Sight`: points are those of the images, and have no noise of their own."""
        self._worlds[row] = world

    def look(self, true: Array, visible: Flags, moved: Flags, trials: Counts, motions: Counts) -> Seen:
        """See `Sight`."""
        self._render(np.flatnonzero(moved), trials, motions)
        return true, visible, *self.images

    def _render(self, rows: NDArray[np.intp], trials: Counts, motions: Counts) -> None:
        if self._renderer is None:
            shadows = self._size >= SHADOWS_FROM
            self._renderer = StereoImages(self._simulation, self._rig, self._size, shadows)
        if self._depth:
            for row in rows.tolist():
                self._images[row] = self._renderer.depths(row, self._worlds[row])
            return
        places = self._places.at(trials, motions)
        parts = np.split(rows, range(TOGETHER, len(rows), TOGETHER))
        exposures = ([self._renderer.exposed(row, self._worlds[row]) for row in part] for part in parts)
        if len(parts) == 1 or not threading.main_thread().is_alive():  # at exit no thread begins
            for part, exposed in zip(parts, exposures, strict=True):
                self._develop(part, exposed, places)
            return
        with ThreadPoolExecutor(max_workers=1) as laboratory:
            before = laboratory.submit(lambda: None)
            for part, exposed in zip(parts, exposures, strict=True):
                before.result()  # it is at most one part behind, and its errors come at once
                before = laboratory.submit(copy_context().run, self._develop, part, exposed, places)
            before.result()

    def _develop(self, rows: NDArray[np.intp], exposures: Sequence[Exposure], places: Array) -> None:
        """Makes images of exposures (n,) of rows (n,), with noise from their places (N, c, 2) in a tile."""
        for row, exposure in zip(rows.tolist(), exposures, strict=True):
            for camera, (lens, pinhole) in enumerate(exposure):
                light, place = lens.colours(pinhole), places[row, camera]
                self._images[row, camera] = self._sensors.image(light, self._worlds[row], camera, place)

    def close(self) -> None:
        """See `Sight`."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class TrackedSight(RenderedSight):
    """Points that a tracker finds in images of 512 x 512 pixels.

    Args:
        simulation, rig, points: See `RenderedSight`.
        tracker: Makes a tracker for one row.
    """

    finds = True
    state_names = ("_trackers", "_points", "_visible")

    def __init__(self, simulation: Simulation, rig: Rig, points: int, tracker: Callable[[], Tracker]) -> None:
        super().__init__(simulation, rig, points, IMAGE_SIZE)
        self.images = ()
        rows = simulation.rows
        first = tracker()
        self._trackers = [first.copy() for _ in range(rows)]
        self._points, self._visible = np.zeros((rows, points, 2)), np.zeros((rows, points), bool)

    def begin_trial(self, rows: NDArray[np.intp]) -> None:
        """See `Sight`: what was tracked before is forgotten."""
        for row in rows.tolist():
            self._trackers[row].reset()

    def look(self, true: Array, visible: Flags, moved: Flags, trials: Counts, motions: Counts) -> Seen:
        """See `Sight`."""
        self._render(np.flatnonzero(moved), trials, motions)
        return self._points.copy(), self._visible.copy()

    def _develop(self, rows: NDArray[np.intp], exposures: Sequence[Exposure], places: Array) -> None:
        """See `RenderedSight`: what is seen in them is found at once."""
        super()._develop(rows, exposures, places)
        if len(rows):
            trackers = [self._trackers[row] for row in rows]
            images = [tuple(self._images[row]) for row in rows]
            self._points[rows], self._visible[rows] = trackers[0].track(trackers, images)


def sight_of(
    simulation: Simulation,
    rig: Rig,
    points: int,
    observation: str,
    image_size: int,
    tracker: Callable[[], Tracker],
) -> Sight:
    """What an observation of that name needs; `tracker` makes one for what is to be found in images."""
    if observation == "points":
        return Sight(simulation.rows, points)
    if observation == "vision":
        return TrackedSight(simulation, rig, points, tracker)
    return RenderedSight(simulation, rig, points, image_size, depth=observation == "depth")
