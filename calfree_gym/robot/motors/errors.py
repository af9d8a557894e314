"""What keeps a motor from going where it is sent: backlash, and motions that do not repeat exactly."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows
from calfree_gym.streams import MotionNumbers

if TYPE_CHECKING:
    from calfree_gym.world import World


class MotorErrors:
    """The errors of the motors of N worlds, one row each.

    Backlash is a play: the joint stays where it is until the motor has gone through the gap, and then lags
    behind by half of it. Repeatability is noise that every motion of a motor, the way home included, draws
    anew; a motor that does not move stays where it is.

    Args:
        rows: N.
        motors: m.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_sent", "_joint", "_noise")

    def __init__(self, rows: int, motors: int) -> None:
        self._half_gap = np.zeros((rows, motors))
        self._deviation = np.zeros((rows, motors))
        self._sent, self._joint, self._noise = (np.zeros((rows, motors)) for _ in range(3))
        self._numbers = MotionNumbers(rows, "repeatability", (motors,), normal=True)
        self._before = self._joint, self._noise
        self._errs = False

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._numbers.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the errors of `world`."""
        self._half_gap[row], self._deviation[row] = world.backlash / 2, world.repeatability
        self._errs = bool(self._half_gap.any() or self._deviation.any())

    @property
    def _exact(self) -> bool:
        """Whether all joints go where they are sent, and stand there."""
        return not (self._errs or self._noise.any() or (self._joint != self._sent).any())

    def stopped(self, row: int, positions: Array, share: float) -> None:
        """The motors of `row` came no farther in the last motion than this share of their way.

        Args:
            row: The row.
            positions: Where they would have been sent (m,) to stand there.
            share: Of the way.
        """
        self._sent[row] = positions
        if self._exact:
            self._joint[row] = positions
            return
        for part, before in zip((self._joint, self._noise), self._before, strict=True):
            part[row] = before[row] + share * (part[row] - before[row])

    def at_home(
        self, rows: Rows, positions: Array, trials: NDArray[np.int64], motions: NDArray[np.int64]
    ) -> Array:
        """Where joints (n, m) stand that were sent home to `positions` (n, m): in the middle of the gap.

        Args:
            rows: Which rows.
            positions: Of their motors' joints at home.
            trials: The trial of all rows (N,).
            motions: Their motion of the trial (N,).
        """
        self._sent[rows] = self._joint[rows] = positions
        if self._exact:
            return positions
        self._noise[rows] = (self._deviation * self._numbers.at(trials, motions))[rows]
        return np.asarray(positions + self._noise[rows])

    def after_a_motion(
        self, rows: Rows, positions: Array, trials: NDArray[np.int64], motions: NDArray[np.int64]
    ) -> Array:
        """Where joints (n, m) come to rest whose motors were sent to `positions` (n, m).

        Args:
            rows: Which rows.
            positions: Where their motors were sent.
            trials: The trial of all rows (N,).
            motions: Their motion of the trial (N,).
        """
        if self._exact:
            self._sent[rows] = self._joint[rows] = positions
            return positions
        self._before = self._joint.copy(), self._noise.copy()
        half_gap, moved = self._half_gap[rows], positions != self._sent[rows]
        self._sent[rows] = positions
        self._joint[rows] = np.clip(self._joint[rows], positions - half_gap, positions + half_gap)
        drawn = (self._deviation * self._numbers.at(trials, motions))[rows]
        self._noise[rows] = np.where(moved, drawn, self._noise[rows])
        return np.asarray(self._joint[rows] + self._noise[rows])
