"""Image points measured at known registers, as arrays: what cameras, arm and motors are identified from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import POINTS, Array, Flags, Observation

MOTORS = 3


@dataclass(frozen=True)
class Measurements:
    """Image points measured at known registers, in several trials.

    Attributes:
        registers: (n, 3).
        points: Image points (n, 4, 2) in image units: gripper left, right, object left, right.
        seen: Which of them were seen (n, 4).
        trial: In which trial (n,), counted from 0 and rising: each has an object of its own.
    """

    registers: Array
    points: Array
    seen: Flags
    trial: NDArray[np.int_]

    @classmethod
    def none(cls) -> Measurements:
        """Nothing measured yet."""
        points = np.zeros((0, POINTS, 2))
        return cls(np.zeros((0, MOTORS)), points, np.zeros((0, POINTS), bool), np.zeros(0, int))

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Measurements:
        """What was saved under the names of the attributes.

        Raises:
            ValueError: An array is missing or of a wrong shape, or trials are not counted from 0.
        """
        points = checked_array(arrays, "points", (None, POINTS, 2))
        count = len(points)
        registers = checked_array(arrays, "registers", (count, MOTORS))
        seen = checked_array(arrays, "seen", (count, POINTS)) > 0
        trial = checked_array(arrays, "trial", (count,)).astype(int)
        if count and not (trial[0] == 0 and np.isin(np.diff(trial), (0, 1)).all()):
            raise ValueError(f"the saved trial must count from 0 in steps of 1, found {trial.tolist()}")
        return cls(registers, points, seen, trial)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.trial.max(initial=-1)) + 1

    def with_trial(self, observations: Sequence[Observation]) -> Measurements:
        """These, and those of one more trial."""
        return Measurements(
            np.concatenate([self.registers, [each.registers for each in observations]]),
            np.concatenate([self.points, [each.points for each in observations]]),
            np.concatenate([self.seen, [each.visible for each in observations]]),
            np.concatenate([self.trial, np.full(len(observations), self.trials)]),
        )

    def latest(self, count: int) -> Measurements:
        """The last `count` of them, their trials counted from 0 again."""
        trial = self.trial[-count:]
        trial = trial - trial.min(initial=self.trials)
        return Measurements(self.registers[-count:], self.points[-count:], self.seen[-count:], trial)
