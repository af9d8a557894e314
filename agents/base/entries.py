"""Entries of one kind, kept as arrays of one length."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Entries:
    """Entries (n); classes derived from it name the arrays (n, ...) that are their parts."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """As named arrays."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def __add__(self, other: Self) -> Self:
        both = zip(self.arrays().values(), other.arrays().values(), strict=True)
        return type(self)(*(np.concatenate(arrays) for arrays in both))

    def only(self, chosen: NDArray[np.bool_] | slice) -> Self:
        """Those that are chosen: flags (n,), or a slice."""
        return type(self)(*(array[chosen] for array in self.arrays().values()))
