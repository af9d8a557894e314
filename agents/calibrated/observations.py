"""What was seen in several trials, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from agents.base.observation import Array, Flags, Observation


@dataclass(frozen=True)
class Looks:
    """What was seen at known registers, in several trials.

    Attributes:
        registers: (n, 3).
        points: Gripper and object points (n, 8).
        seen: Which of their coordinates were seen (n, 8).
        trial: In which trial (n,), counted from 0: each has an object of its own.
    """

    registers: Array
    points: Array
    seen: Flags
    trial: Array

    @classmethod
    def none(cls) -> Looks:
        """Nothing seen yet."""
        return cls(np.zeros((0, 3)), np.zeros((0, 8)), np.zeros((0, 8), bool), np.zeros(0, int))

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.trial.max(initial=-1)) + 1

    def and_trial(self, looks: Sequence[Observation]) -> Looks:
        """These, and those of one more trial."""
        return Looks(
            np.concatenate([self.registers, [look.registers for look in looks]]),
            np.concatenate([self.points, [look.points.ravel() for look in looks]]),
            np.concatenate([self.seen, [np.repeat(look.visible, 2) for look in looks]]),
            np.concatenate([self.trial, np.full(len(looks), self.trials)]),
        )

    def latest(self, count: int) -> Looks:
        """The last `count` of them."""
        trial = self.trial[-count:]
        trial = trial - trial.min(initial=self.trials)
        return Looks(self.registers[-count:], self.points[-count:], self.seen[-count:], trial)
