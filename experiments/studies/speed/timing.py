"""Times as ratios: both sides in turns within one run, so that a drifting machine cancels."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

Timer = Callable[[], float]
"""Does something once, and tells the seconds that one unit of it took."""


class Line(NamedTuple):
    """One line of the table.

    Attributes:
        what: What took so long, and beside what.
        seconds: Of one unit, the median over rounds.
        beside: Of the other side, if there is one.
        ratio: Median over rounds of the other's time by ours: how many times as fast we are.
        required: The least ratio that the project asks of itself, if it asks.
    """

    what: str
    seconds: float
    beside: float | None = None
    ratio: float | None = None
    required: float | None = None


def alone(what: str, timer: Timer, rounds: int) -> Line:
    """What is beside nothing."""
    return Line(what, float(np.median([timer() for _ in range(rounds)])))


def in_turns(what: str, ours: Timer, other: Timer, rounds: int, required: float | None = None) -> Line:
    """Both in turns."""
    seconds = np.array([(ours(), other()) for _ in range(rounds)])
    ratio = float(np.median(seconds[:, 1] / seconds[:, 0]))
    mine, others = np.median(seconds, axis=0)
    return Line(what, float(mine), float(others), ratio, required)


def timer(
    function: Callable[[], object], units: float, clock: Callable[[], float] = time.perf_counter
) -> Timer:
    """Seconds of a unit, where a call makes so many of them."""

    def seconds() -> float:
        start = clock()
        function()
        return (clock() - start) / units

    return seconds


def written(seconds: float | None) -> str:
    """With two digits and more, in the unit in which they are easiest to read."""
    if seconds is None:
        return ""
    units = ((1e-6, "µs"), (1e-3, "ms"), (1.0, "s"))
    unit, name = next((each for each in units if seconds < 999.5 * each[0]), units[-1])
    return f"{seconds / unit:.{1 if seconds < 9.95 * unit else 0}f} {name}"


@contextmanager
def pinned(cores: int) -> Iterator[None]:
    """Holds the process to this many cores, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, set(sorted(before)[:cores]))
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
