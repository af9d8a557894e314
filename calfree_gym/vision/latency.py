"""What was observed is delivered some motions later."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

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

    state_names: ClassVar[tuple[str, ...]] = ("_queues", "_beginning")

    def __init__(self, rows: int) -> None:
        self._latency = np.zeros(rows, np.int64)
        self._beginning = np.zeros(rows, bool)
        self._queues: list[dict[int, tuple[NDArray[Any], ...]]] = [{} for _ in range(rows)]

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the latency of `world`."""
        if not world.latency:
            self._queues[row].clear()
        self._beginning[row] |= world.latency > 0 and self._latency[row] == 0
        self._latency[row] = world.latency

    def deliver(self, motions: NDArray[np.int64], *observed: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """What comes out of the queues, as many motions late as each world is.

        Args:
            motions: Of the trial (N,).
            observed: Arrays (N, ...).
        """
        if not self._latency.any():
            return observed
        late = tuple(each.copy() for each in observed)
        for row, (queue, motion) in enumerate(zip(self._queues, motions.tolist(), strict=True)):
            if self._beginning[row] or motion == 0:
                queue.clear()
            queue[motion] = tuple(each[row].copy() for each in observed)
            queue.pop(motion - MAX_LATENCY - 1, None)
            due = queue[max(motion - int(self._latency[row]), min(queue))]
            for each, delivered in zip(late, due, strict=True):
                each[row] = delivered
        self._beginning[:] = False
        return late
