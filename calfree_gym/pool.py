"""Worlds that are made once, and then given to any of N rows at the price of copying numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from calfree_gym.world.value import World


class OfWorlds:
    """A part of N rows, some of whose numbers are what their worlds make them.

    Attributes:
        of_world: Names of these arrays (N, ...).
    """

    of_world: ClassVar[tuple[str, ...]] = ()

    def note_worlds(self) -> None:
        """Notes what is true of all rows together, whenever one is in another world."""


class WorldPool:
    """A pool of worlds, and what the parts of N rows have made of each.

    Attributes:
        worlds: Those that are known (size,); None where one was never asked for.

    Args:
        size: How many worlds there are.
        parts: Of the N rows.
    """

    def __init__(self, size: int, parts: Sequence[OfWorlds]) -> None:
        self.worlds: NDArray[Any] = np.full(size, None)
        self._parts = parts
        self._made = [
            {name: np.empty((size, *array.shape[1:]), array.dtype) for name, array in _arrays(part)}
            for part in parts
        ]

    def keep(self, place: int, world: World, row: int) -> None:
        """Keeps a world at its place, and what parts have made of it in this row."""
        self.worlds[place] = world
        for part, made in zip(self._parts, self._made, strict=True):
            for name, array in _arrays(part):
                made[name][place] = array[row]

    def put(self, rows: NDArray[np.intp], places: NDArray[np.intp]) -> None:
        """Puts the parts of rows (n,) into the worlds at these places (n,), which are kept."""
        for part, made in zip(self._parts, self._made, strict=True):
            for name, array in _arrays(part):
                array[rows] = made[name][places]
            part.note_worlds()


def _arrays(part: OfWorlds) -> list[tuple[str, NDArray[Any]]]:
    return [(name, getattr(part, name)) for name in part.of_world]
