"""What a robot has observed on its own motions, and the pairs of observations that teach."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.checks import checked_array
from ...base.observation import Array, Observation

SENSORS = 8
"""Length of both sensor vectors, the gripper's and the object's."""


class ReplayPairs(NamedTuple):
    """Ordered pairs of observations of the same trial.

    Attributes:
        sensors: The gripper's and the object's sensor vectors (n, 8) in the first one.
        registers: Of the first one (n, m).
        change: How the image distance d changed to the second one (n, 4).
        words: By which words (n, m), in sum, the robot came from the first one to the second.
        doubtful: Which of them (n,) are from before a change of the world.
    """

    sensors: Array
    registers: Array
    change: Array
    words: Array
    doubtful: NDArray[np.bool_]

    @classmethod
    def of(cls, before: Observation, after: Observation) -> ReplayPairs:
        """The pair (n = 1) of two observations."""
        return cls(
            sensors=before.points.reshape(1, SENSORS),
            registers=before.registers[None],
            change=(after.distance - before.distance)[None],
            words=(after.registers - before.registers)[None],
            doubtful=np.zeros(1, bool),
        )


class Replay:
    """The latest observations in which all points were seen, trial by trial.

    Attributes:
        capacity: How many observations are kept at most.
        added: How many it has ever been given.
    """

    ENOUGH_NEW = 40
    """After a change of the world half of the pairs drawn are new once there are so many new observations: as
    many as a new robot begins to learn from."""

    def __init__(self, motors: int, capacity: int) -> None:
        self.capacity = capacity
        self._sensors = np.zeros((0, SENSORS))
        self._registers = np.zeros((0, motors))
        self._trials = np.zeros(0, np.int64)
        self._first = self._size = 0
        self._doubtful = 0
        self.added = 0

    def __len__(self) -> int:
        return self._size - self._first

    @property
    def sensors(self) -> Array:
        """All sensor vectors (n, 8) that it holds: gripper's, object's."""
        return self._sensors[self._first : self._size]

    @property
    def registers(self) -> Array:
        """All registers (n, m) that it holds."""
        return self._registers[self._first : self._size]

    @property
    def trials(self) -> NDArray[np.int64]:
        """In which trial each observation was made (n,), ascending."""
        return self._trials[self._first : self._size]

    def add(self, observation: Observation, trial: int) -> None:
        """Keeps an observation of a trial, unless a point was out of view in it."""
        if not observation.visible.all():
            return
        if self._size == len(self._sensors):
            self._make_room()
        self._sensors[self._size] = observation.points.reshape(SENSORS)
        self._registers[self._size] = observation.registers
        self._trials[self._size] = trial
        self._size += 1
        self.added += 1
        self._first = max(self._first, self._size - self.capacity)
        self._doubtful = max(self._doubtful, self._first)

    def doubt(self, added: int) -> None:
        """Takes all but what was added since `added` for doubtful: it is from before a change of the world.

        A trial that spans the change becomes two: no pair of observations spans it.
        """
        self._doubtful = max(self._first, self._size - (self.added - added))
        self._trials[self._doubtful : self._size] += 1

    def reverse(self, signs: Array, added: int) -> None:
        """Gives the registers of all but what was added since `added` other signs (m,), as `doubt` splits."""
        before = slice(self._first, max(self._first, self._size - (self.added - added)))
        self._registers[before] *= signs
        self._trials[before.stop : self._size] += 1

    def sample(self, count: int, rng: np.random.Generator, consecutive: bool = False) -> ReplayPairs:
        """Draws pairs: a first observation, and another one of the same trial, uniformly.

        Where most are doubtful, half of the first ones are not, or less while these are few.

        Args:
            count: How many to draw; those whose first observation has no partner are left out.
            rng: Draws them.
            consecutive: Whether the other one is the next one; otherwise it is any, before or after.

        Returns:
            The pairs; there may be none.
        """
        sensors, registers, trials = self.sensors, self.registers, self.trials
        first = self._draw(count, rng)
        begin = np.searchsorted(trials, trials[first], "left")
        end = np.searchsorted(trials, trials[first], "right")
        if consecutive:
            begin, end = first, np.minimum(end, first + 2)
        others = end - begin - 1
        first, begin, others = (each[others > 0] for each in (first, begin, others))
        second = begin + (first - begin + 1 + rng.integers(others)) % (others + 1)
        change = sensors[second] - sensors[first]
        return ReplayPairs(
            sensors[first],
            registers[first],
            change[:, :4] - change[:, 4:],
            registers[second] - registers[first],
            first < self._doubtful - self._first,
        )

    def _draw(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Indices (n,) of observations."""
        old, size = self._doubtful - self._first, len(self)
        drawn = rng.integers(size, size=count)
        if not size / 2 < old < size:
            return drawn
        share = min(1.0, (size - old) / self.ENOUGH_NEW) / 2
        new = rng.random(count) < share
        return np.where(new, rng.integers(old, size, count), rng.integers(old, size=count))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it holds, by name."""
        return {
            "sensors": self.sensors.copy(),
            "registers": self.registers.copy(),
            "trials": self.trials.copy(),
            "doubtful": np.array(self._doubtful - self._first),
            "added": np.array(self.added),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: An array is missing, damaged or of another shape.
        """
        sensors = checked_array(arrays, "sensors", (None, SENSORS))
        registers = checked_array(arrays, "registers", (len(sensors), self._registers.shape[1]))
        trials = checked_array(arrays, "trials", (len(sensors),)).astype(np.int64)
        if (np.diff(trials) < 0).any():
            raise ValueError("the saved trials do not ascend")
        doubtful = int(checked_array(arrays, "doubtful", ()))
        if not 0 <= doubtful <= len(sensors):
            raise ValueError(f"{doubtful} of {len(sensors)} saved observations are doubtful")
        self.added = int(checked_array(arrays, "added", ()))
        self._sensors, self._registers, self._trials = sensors, registers, trials
        self._first, self._size, self._doubtful = 0, len(sensors), doubtful

    def _make_room(self) -> None:
        """Moves what is kept to the front of arrays that are twice as long."""
        kept, self._doubtful = len(self), self._doubtful - self._first
        for name in ("_sensors", "_registers", "_trials"):
            old = getattr(self, name)
            new = np.zeros((2 * kept + 64, *old.shape[1:]), old.dtype)
            new[:kept] = old[self._first : self._size]
            setattr(self, name, new)
        self._first, self._size = 0, kept
