"""The paper's table: registers at the corners of a grid in sensor space (section 4.2; Xie et al. 1997)."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.agent import Array
from agents.knowledge.knowledge import Change, Recall

DIMENSIONS = 4
_CORNERS = np.array(list(product((0, 1), repeat=DIMENSIONS)))


class GridTable:
    """4-D sensor space in `cells`**4 hypercubes, with a record of registers at each of their corners.

    A cell met for the first time gets the registers that led to success at all of its corners without a
    record. A cell whose 16 corners all have records recalls by multilinear interpolation; each success
    then corrects the corners by their interpolation weights, so that nearer corners change more. How
    Xie et al. weighted distance is not public; this is the least change that makes a recall right.

    Attributes:
        records: Registers (cells + 1, ... four times, motors); NaN where there is none.

    Args:
        motors: Number of registers.
        cells: Cells along each sensor dimension.
        rate: Share of a recall's error that one success corrects.
    """

    def __init__(self, motors: int, cells: int = 8, rate: float = 0.7) -> None:
        if isinstance(cells, bool) or not isinstance(cells, int) or cells < 1:
            raise ValueError(f"cells is {cells!r}; it must be a whole number, 1 or more")
        if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate <= 1:
            raise ValueError(f"rate is {rate!r}; it must be a number above 0, at most 1")
        self.cells = cells
        self.rate = rate
        self.records = np.full((*[cells + 1] * DIMENSIONS, motors), np.nan)

    def __repr__(self) -> str:
        return f"GridTable(cells={self.cells}, rate={self.rate})"

    def recall(self, sensors: Array) -> Recall | None:
        """Interpolated registers; None where a corner of the cell has no record."""
        corners, weights = self._cell(sensors)
        records = self.records[corners]
        return None if np.isnan(records).any() else Recall(weights @ records, 0.0)

    def jacobian(self, registers: Array) -> None:
        """See `Knowledge`. A table implies none: in the paper test motions measure it."""

    def learn(self, sensors: Array, registers: Array) -> None:
        """Fills the empty corners of the cell and corrects all of them."""
        corners, weights = self._cell(sensors)
        records = self.records[corners]
        records = np.where(np.isnan(records), registers, records)
        missed = registers - weights @ records
        gain = self.rate * weights / (weights @ weights)
        self.records[corners] = records + gain[:, None] * missed

    def map(self, change: Change, deviation_px: Array) -> None:
        """See `Knowledge`. Each record is taken for a success at where its corner has gone."""
        raise NotImplementedError

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `Knowledge`."""
        return {"records": self.records}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `Knowledge`."""
        records = arrays["records"]
        if records.shape != self.records.shape:
            raise ValueError(f"the saved table has shape {records.shape}, this one {self.records.shape}")
        self.records = records.copy()

    def _cell(self, sensors: Array) -> tuple[tuple[NDArray[np.intp], ...], Array]:
        """Indices of the 16 corners around a sensor vector, and their interpolation weights (16,)."""
        place = (np.clip(sensors, -1, 1) + 1) / 2 * self.cells
        cell = np.minimum(place.astype(np.intp), self.cells - 1)
        part = place - cell
        weights = np.where(_CORNERS, part, 1 - part).prod(1)
        return tuple((cell + _CORNERS).T), weights
