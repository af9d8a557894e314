"""From where points truly are to what the vision system delivers: noise, outliers, dropout, latency."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.streams import LookNumbers
from calfree_gym.world import MAX_LATENCY, World

Counts = NDArray[np.int64]


class Sensing:
    """The vision systems of N worlds, one row each."""

    def __init__(self, rows: int) -> None:
        self._noise = np.zeros((rows, 1, 1))
        self._outliers = np.zeros((rows, 1))
        self._dropout = np.zeros((rows, 1))
        self._latency = np.zeros(rows, np.int64)
        self._normals = LookNumbers(rows, "noise", (4, 2), normal=True)
        self._strays = LookNumbers(rows, "outliers", (4, 3), normal=False)
        self._losses = LookNumbers(rows, "dropout", (4,), normal=False)
        self._line_points = np.zeros((rows, MAX_LATENCY + 1, 4, 2))
        self._line_visible = np.zeros((rows, MAX_LATENCY + 1, 4), bool)
        self._any_strays = self._any_losses = self._any_late = False
        self._filling = np.zeros(rows, bool)
        self._all = np.arange(rows)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        for numbers in (self._normals, self._strays, self._losses):
            numbers.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the sensing of `world`."""
        self._noise[row] = world.point_noise * IMAGE_UNIT
        self._outliers[row] = world.point_outliers
        self._dropout[row] = world.point_dropout
        self._filling[row] = world.latency > 0 and self._latency[row] == 0
        self._latency[row] = world.latency
        self._any_strays = bool(self._outliers.any())
        self._any_losses = bool(self._dropout.any())
        self._any_late = bool(self._latency.any())

    def measure(self, true: Array, visible: Flags, trials: Counts, motions: Counts) -> tuple[Array, Flags]:
        """Measured points (N, 4, 2) and flags (N, 4) of a look, from the true ones.

        An outlier stands anywhere in the image; what drops out is not seen in this look.
        """
        measured = true + self._noise * self._normals.at(trials, motions)
        measured = np.minimum(np.maximum(measured, -1), 1)
        if self._any_strays:
            strays = self._strays.at(trials, motions)
            astray = strays[:, :, 0] < self._outliers
            measured = np.where(astray[:, :, None], 2 * strays[:, :, 1:] - 1, measured)
        if self._any_losses:
            visible = visible & (self._losses.at(trials, motions) >= self._dropout)
        return measured, visible

    def deliver(self, points: Array, visible: Flags, motions: Counts) -> tuple[Array, Flags]:
        """What comes out of the line, as many motions late as each world is.

        A new trial's line holds the home look; a line that forms in mid-trial, the look at that time.
        """
        if not self._any_late:
            return points, visible
        slots = MAX_LATENCY + 1
        self._line_points[self._filling] = points[self._filling, None]
        self._line_visible[self._filling] = visible[self._filling, None]
        self._filling[:] = False
        self._line_points[self._all, motions % slots] = points
        self._line_visible[self._all, motions % slots] = visible
        due = np.maximum(motions - self._latency, 0) % slots
        return self._line_points[self._all, due], self._line_visible[self._all, due]
