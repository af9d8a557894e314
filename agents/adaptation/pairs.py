"""What was seen, and where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array


@dataclass(frozen=True)
class Pairs:
    """Registers and what is seen there.

    Attributes:
        registers: Registers (n, m).
        sensors: Sensor vectors (n, 4) of what is seen there, in image units.
        trials: The trial (n,) of each, counted from 0.
    """

    registers: Array
    sensors: Array
    trials: NDArray[np.int64]

    @classmethod
    def none(cls, motors: int) -> Self:
        """No pairs, for that number of registers."""
        return cls(np.empty((0, motors)), np.empty((0, 4)), np.empty(0, np.int64))

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """From what `arrays` returned.

        Raises:
            ValueError: An array is missing, or of another shape than the others.
        """
        registers = checked_array(arrays, "registers", (None, None))
        sensors = checked_array(arrays, "sensors", (len(registers), 4))
        trials = checked_array(arrays, "trials", (len(registers),))
        return cls(registers, sensors, trials.astype(np.int64))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """As named arrays."""
        return {"registers": self.registers, "sensors": self.sensors, "trials": self.trials}

    def __len__(self) -> int:
        return len(self.trials)

    def __add__(self, other: Pairs) -> Pairs:
        return Pairs(
            np.concatenate([self.registers, other.registers]),
            np.concatenate([self.sensors, other.sensors]),
            np.concatenate([self.trials, other.trials]),
        )

    def only(self, chosen: NDArray[np.bool_]) -> Pairs:
        """Those that are chosen (n,)."""
        return Pairs(self.registers[chosen], self.sensors[chosen], self.trials[chosen])

    def away(self) -> Pairs:
        """All but the first, in a trial that begins at home."""
        return Pairs(self.registers[1:], self.sensors[1:], self.trials[1:])

    def latest(self, trials: int) -> Pairs:
        """Those of that number of latest trials."""
        return self.only(self.trials > self.trials.max(initial=0) - trials)
