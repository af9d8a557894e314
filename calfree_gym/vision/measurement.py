"""From true image points to delivered ones: noise, outliers, dropout, latency."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.streams import MotionNumbers

if TYPE_CHECKING:
    from calfree_gym.world import World

MAX_LATENCY = 10
"""The largest latency of image points, in motions."""

Counts = NDArray[np.int64]


class MeasurementModel:
    """The vision systems of N worlds, one row each: true image points in, measured ones out."""

    state_names: ClassVar[tuple[str, ...]] = ("_queue_points", "_queue_visible", "_filling")

    def __init__(self, rows: int) -> None:
        self._noise = np.zeros((rows, 4, 2))
        self._outliers = np.zeros((rows, 1))
        self._dropout = np.zeros((rows, 1))
        self._latency = np.zeros(rows, np.int64)
        self._noise_numbers = MotionNumbers(rows, "noise", (4, 2), normal=True)
        self._outlier_numbers = MotionNumbers(rows, "outliers", (4, 3), normal=False)
        self._dropout_numbers = MotionNumbers(rows, "dropout", (4,), normal=False)
        self._queue_points = np.zeros((rows, MAX_LATENCY + 1, 4, 2))
        self._queue_visible = np.zeros((rows, MAX_LATENCY + 1, 4), bool)
        self._any_outliers = self._any_dropout = self._any_late = False
        self._filling = np.zeros(rows, bool)
        self._all = np.arange(rows)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        for numbers in (self._noise_numbers, self._outlier_numbers, self._dropout_numbers):
            numbers.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` noise, outliers, dropout and latency of `world`."""
        self._noise[row] = world.point_noise * IMAGE_UNIT
        self._outliers[row] = world.point_outliers
        self._dropout[row] = world.point_dropout
        self._filling[row] = world.latency > 0 and self._latency[row] == 0
        self._latency[row] = world.latency
        self._any_outliers = bool(self._outliers.any())
        self._any_dropout = bool(self._dropout.any())
        self._any_late = bool(self._latency.any())

    def measure(self, true: Array, visible: Flags, trials: Counts, motions: Counts) -> tuple[Array, Flags]:
        """Measured points (N, 4, 2) and flags (N, 4) of one observation, from the true ones.

        An outlier stands anywhere in the image. A point that drops out is not seen this time.
        """
        measured = (true + self._noise * self._noise_numbers.at(trials, motions)).clip(-1, 1)
        if self._any_outliers:
            drawn = self._outlier_numbers.at(trials, motions)
            outlier = drawn[:, :, 0] < self._outliers
            measured = np.where(outlier[:, :, None], 2 * drawn[:, :, 1:] - 1, measured)
        if self._any_dropout:
            visible = visible & (self._dropout_numbers.at(trials, motions) >= self._dropout)
        return measured, visible

    def deliver(self, points: Array, visible: Flags, motions: Counts) -> tuple[Array, Flags]:
        """Points and flags that come out of the queue, as many motions late as each world is.

        The queue of a new trial holds the observation at home. Where latency begins in mid-trial, the queue
        holds the observation of that time.
        """
        if not self._any_late:
            return points, visible
        slots = MAX_LATENCY + 1
        self._queue_points[self._filling] = points[self._filling, None]
        self._queue_visible[self._filling] = visible[self._filling, None]
        self._filling[:] = False
        self._queue_points[self._all, motions % slots] = points
        self._queue_visible[self._all, motions % slots] = visible
        due = np.maximum(motions - self._latency, 0) % slots
        return self._queue_points[self._all, due], self._queue_visible[self._all, due]
