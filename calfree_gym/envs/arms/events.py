"""Events of a schedule change the worlds of arms wholly, or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calfree_gym.perturbations.application import Applied, PerturbationScheduler

if TYPE_CHECKING:
    from calfree_gym.envs.arms.base import Arms


def apply_due(
    arms: Arms,
    scheduler: PerturbationScheduler,
    clock: str,
    counts: NDArray[np.int64],
    rows: NDArray[np.intp],
) -> list[Applied]:
    """Applies the events that are due in `rows`; the stops of these arms may move.

    Args:
        arms: The arms.
        scheduler: Of their events.
        clock: "motion" or "trial".
        counts: How many of these are over (N,).
        rows: The rows.

    Returns:
        What was applied.
    """
    due = [
        (place, event, row)
        for place, event in scheduler.events[clock]
        for row in rows[event.is_due(counts[rows])].tolist()
    ]
    if not due:
        return []
    applied: list[Applied] = []
    with undivided(arms, scheduler, {row for *_, row in due}):
        for place, event, row in due:
            world, perturbation = scheduler.apply(place, event, row, int(counts[row]), arms.world(row))
            arms.enter(row, world)
            if perturbation is not None:
                applied.append((row, perturbation))
    return applied


@contextmanager
def undivided(arms: Arms, scheduler: PerturbationScheduler, rows: Iterable[int]) -> Iterator[None]:
    """Where an error leaves the block, worlds and schedules of these rows are as they were.

    So who catches it and goes on gets no event twice.
    """
    before = [(row, arms.world(row), scheduler.kept(row)) for row in rows]
    try:
        yield
    except Exception:
        for row, world, kept in before:
            arms.enter(row, world)
            scheduler.go_on_with(row, kept)
        raise
