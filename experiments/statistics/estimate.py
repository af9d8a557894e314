"""A number with its interval."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.95
"""Of all intervals in tables."""
ENOUGH_WORLDS = 20
"""With fewer, numbers over worlds have no interval, single worlds are drawn, and nobody is ranked."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval; both limits are NaN where it has none."""

    value: float
    low: float = math.nan
    high: float = math.nan

    @property
    def has_interval(self) -> bool:
        """Whether there were enough worlds for one."""
        return not math.isnan(self.low)
