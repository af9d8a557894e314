"""How long the runs of a suite still take: kept times, corrected by what this machine has shown."""

import time
from collections.abc import Callable, Iterable

_SURE = 20.0
"""Seconds of work, as kept times have it, from which on this machine's own pace counts more. Choice."""


class TimeLeft:
    """Of runs that are made some at a time, the longest first.

    Args:
        expected: Seconds of each run where kept times were made, by its id, in the order in which they begin.
        at_once: How many runs are made at a time; None where that shows by and by.
        now: Tells the time in seconds.
    """

    def __init__(
        self,
        expected: dict[str, float],
        at_once: int | None,
        now: Callable[[], float] = time.monotonic,
    ):
        self._expected, self._at_once, self._now = expected, at_once, now
        self._begun: dict[str, float] = {}
        self._share: dict[str, float] = {}
        self._over: list[tuple[float, float]] = []

    def begins(self, run: str) -> None:
        """A run begins."""
        self._begun[run] = self._now()

    def has_made(self, run: str, share: float) -> None:
        """A run that has begun has made this share of its work."""
        self._share[run] = share

    def ends(self, run: str, took: float | None) -> None:
        """A run is over, after so many seconds; None where that tells nothing of others."""
        expected = self._expected.pop(run)
        self._begun.pop(run, None)
        self._share.pop(run, None)
        if took is not None:
            self._over.append((expected, took))

    def seconds(self) -> float:
        """Until all runs are over."""
        shares = {run: self._share.get(run, 0.0) for run in self._expected}
        under_way = [
            (shares[run] * self._expected[run], self._now() - self._begun[run]) for run in self._begun
        ]
        pace = _pace([*self._over, *((done, took) for done, took in under_way if done)])
        left = [(1 - shares[run]) * seconds for run, seconds in self._expected.items()]
        return pace * _one_after_the_other(left, self._at_once or max(len(self._begun), 1))


def _pace(made: Iterable[tuple[float, float]]) -> float:
    """How many times as long as expected work takes here, of expected seconds and those that it took."""
    sums = [sum(column) for column in zip((_SURE, _SURE), *made, strict=True)]
    return sums[1] / sums[0]


def _one_after_the_other(seconds: Iterable[float], at_once: int) -> float:
    """When the last of some runs is over, each of which begins as soon as there is a place."""
    places = [0.0] * at_once
    for each in seconds:
        places[places.index(min(places))] += each
    return max(places)


def in_words(seconds: float) -> str:
    """A rounded time, such as "4 min"."""
    if seconds < 55:
        return f"{max(10 * round(seconds / 10), 10)} s"
    return f"{round(seconds / 60)} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"
