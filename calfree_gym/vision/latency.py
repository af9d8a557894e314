"""What was observed is delivered some motions later."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from calfree_gym.world import World

MAX_LATENCY = 10
"""The largest latency, in motions."""


class Latency:
    """Queues of observations of N worlds, one row each.

    The queue of a new trial holds the observation at home. Where latency begins in mid-trial, the queue holds
    the observation of that time.

    Args:
        rows: N.
    """

    def __init__(self, rows: int) -> None:
        self._latency = np.zeros(rows, np.int64)
        self._filling = np.zeros(rows, bool)
        self._queues: tuple[NDArray[Any], ...] = ()
        self._all = np.arange(rows)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the latency of `world`."""
        self._filling[row] = world.latency > 0 and self._latency[row] == 0
        self._latency[row] = world.latency

    def deliver(self, motions: NDArray[np.int64], *observed: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """What comes out of the queues, as many motions late as each world is.

        Args:
            motions: Of the trial (N,).
            observed: Arrays (N, ...), always of the same kinds.
        """
        if not self._latency.any():
            return observed
        slots = MAX_LATENCY + 1
        if not self._queues:
            self._queues = tuple(
                np.zeros((len(each), slots, *each.shape[1:]), each.dtype) for each in observed
            )
        due = np.maximum(motions - self._latency, 0) % slots
        for queue, now in zip(self._queues, observed, strict=True):
            queue[self._filling] = now[self._filling, None]
            queue[self._all, motions % slots] = now
        self._filling[:] = False
        return tuple(queue[self._all, due] for queue in self._queues)
