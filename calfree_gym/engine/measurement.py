"""From true image points to delivered ones: noise, outliers, dropout, latency."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.streams import MotionNumbers
from calfree_gym.world.value import MAX_LATENCY, World

Counts = NDArray[np.int64]


class MeasurementModel:
    """The vision systems of N worlds, one row each: true image points in, measured ones out.

    Args:
        rows: N.
        points: p, of both images together.
    """

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
        self._any_outliers = bool(self._outliers.any())
        self._any_dropout = bool(self._dropout.any())

    def measure(self, true: Array, visible: Flags, trials: Counts, motions: Counts) -> tuple[Array, Flags]:
        """Measured points (N, p, 2) and flags (N, p) of one observation, from the true ones.

        An outlier stands anywhere in the image. A point that drops out is not seen this time.
        """
        measured = true + self._noise * self._noise_numbers.at(trials, motions)
        measured = np.minimum(np.maximum(measured, -1.0), 1.0)  # faster than clip
        if self._any_outliers:
            drawn = self._outlier_numbers.at(trials, motions)
            outlier = drawn[:, :, 0] < self._outliers
            measured = np.where(outlier[:, :, None], 2 * drawn[:, :, 1:] - 1, measured)
        if self._any_dropout:
            visible = visible & (self._dropout_numbers.at(trials, motions) >= self._dropout)
        return measured, visible


class Latency:
    """Queues of observations of N worlds, one row each.

    The queue of a new trial holds the observation at home. Where latency begins in mid-trial, the queue holds
    the observation of that time.

    Args:
        rows: N.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_queues", "_beginning")

    def __init__(self, rows: int) -> None:
        self._latency = np.zeros(rows, np.int64)
        self._beginning = np.zeros(rows, bool)
        self._queues: list[dict[int, tuple[NDArray[Any], ...]]] = [{} for _ in range(rows)]

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the latency of `world`."""
        if not world.latency:
            self._queues[row].clear()
        self._beginning[row] |= world.latency > 0 and self._latency[row] == 0
        self._latency[row] = world.latency

    def deliver(self, motions: NDArray[np.int64], *observed: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """What comes out of the queues, as many motions late as each world is.

        Args:
            motions: Of the trial (N,).
            observed: Arrays (N, ...).
        """
        if not self._latency.any():
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
