"""What was seen, and where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from agents.base.observation import Array


@dataclass(frozen=True)
class Pairs:
    """Registers (n, m), sensor vectors (n, 4) of what is seen there, and the trial (n,) of each."""

    registers: Array
    sensors: Array
    trials: NDArray[np.int64]

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """From what `arrays` returned."""
        return cls(arrays["registers"], arrays["sensors"], arrays["trials"])

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

    def latest(self, trials: int) -> Pairs:
        """Those of the latest so many trials."""
        late = self.trials > self.trials.max(initial=0) - trials
        return Pairs(self.registers[late], self.sensors[late], self.trials[late])
