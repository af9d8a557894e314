"""All looks of all trials, as regression takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.entries import Entries
from ..base.observation import Array, Observation


@dataclass(frozen=True)
class RegressionLooks(Entries):
    """What was seen where.

    Attributes:
        registers: Registers (n, m).
        homes: The object's sensor vector (n, 4) at home, in the same trial.
        points: Gripper's and object's sensor vectors (n, 2, 4); NaN where a camera did not see them.
        noise_px: Standard deviation (n,) of an image coordinate, as far as known then.
    """

    registers: Array
    homes: Array
    points: Array
    noise_px: Array

    @classmethod
    def none(cls, motors: int) -> Self:
        """No look, with that number of registers."""
        return cls(np.empty((0, motors)), np.empty((0, 4)), np.empty((0, 2, 4)), np.empty(0))

    @classmethod
    def one(cls, seen: Observation, home: Observation, noise_px: float) -> Self:
        """A look, in a trial that began with `home`; the object counts where it was seen then, too."""
        visible = seen.visible & np.append([True, True], home.visible[2:])
        points = np.where(visible[:, None], seen.points, np.nan).reshape(1, 2, 4)
        if not home.shows_object:
            points[:, 1] = np.nan
        return cls(seen.registers[None], home.object[None], points, np.array([noise_px]))

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], motors: int) -> Self:
        """From what `arrays` returned; raises ValueError where it does not fit."""
        registers = checked_array(arrays, "registers", (None, motors))
        count = len(registers)
        return cls(
            registers,
            checked_array(arrays, "homes", (count, 4)),
            checked_array(arrays, "points", (count, 2, 4), allow_nan=True),
            checked_array(arrays, "noise_px", (count,)),
        )

    def without(self, cameras: NDArray[np.bool_]) -> Self:
        """What the other cameras saw; `cameras` (2,) are forgotten."""
        points = np.where(np.repeat(cameras, 2), np.nan, self.points)
        return replace(self, points=points).only(np.asarray(np.isfinite(points).any((1, 2))))
