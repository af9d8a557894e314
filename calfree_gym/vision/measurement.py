"""From true image points to measured ones: noise, outliers, dropout."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.streams import MotionNumbers

if TYPE_CHECKING:
    from calfree_gym.world import World

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
