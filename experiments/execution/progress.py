"""How far the runs are, and how long they still take: a bar on a terminal, plain lines elsewhere; a table."""

import os
import re
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import pandas as pd
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from experiments.execution.pending import newest_folder, pending_of
from experiments.running.results_folder import (
    FAILED,
    LOG,
    RUN,
    at_work,
    folder_of,
    is_done,
    read_json,
    read_suite,
)
from experiments.running.run import Run, runs_of

_DONE = re.compile(r"^(?:motions|trials) (\d+)/", re.MULTILINE)
_TAIL = 10_000
"""Bytes at the end of a log in which a line of progress is looked for."""
_SURE = 20.0
"""Seconds of work, as kept times have it, from which on this machine's own pace counts more. Choice."""


def made_in(folder: Path) -> int:
    """How much of its work a run says it has done, in its log."""
    try:
        with (folder / LOG).open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - _TAIL))
            found = _DONE.findall(log.read().decode(errors="replace"))
    except FileNotFoundError:
        return 0
    return int(found[-1]) if found else 0


@dataclass(frozen=True, slots=True)
class AtWork:
    """A run under way, in words, and how much of its work is done: of an amount of "motions" or "trials"."""

    what: str
    made: int
    amount: int
    unit: str


@dataclass(frozen=True, slots=True)
class Standing:
    """How far a suite is: runs that are over, of all; about how many seconds are left; runs under way."""

    over: int
    runs: int
    left: float
    at_work: tuple[AtWork, ...]

    def __str__(self) -> str:
        left = f", about {in_words(self.left)} left" if self.over < self.runs else ""
        return f"{self.over} of {self.runs}{left}"


class Lines:
    """Plain lines: one where runs have ended."""

    def __init__(self) -> None:
        self._over = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        pass

    def say(self, text: str) -> None:
        """Prints a line."""
        print(text, flush=True)

    def show(self, now: Standing) -> None:
        """Prints how far the suite is, where more runs are over than last time."""
        if now.over > self._over:
            self._over = now.over
            self.say(f"{now}")


class Bar(Live):
    """A bar for the suite, and below it a line for each run under way."""

    def __init__(self, console: Console):
        super().__init__(console=console, refresh_per_second=4, transient=True)

    def say(self, text: str) -> None:
        """Prints a line above the bar."""
        self.console.print(text, markup=False, highlight=False)

    def show(self, now: Standing) -> None:
        """Moves the bar by whole runs and what is made of those under way."""
        made = now.over + sum(each.made / each.amount for each in now.at_work)
        head = Table.grid(padding=(0, 1))
        head.add_row(ProgressBar(total=now.runs, completed=made, width=40), str(now))
        lines = Table.grid(padding=(0, 2))
        for each in now.at_work:
            lines.add_row(f"  {each.what}", f"{each.made:,} of {each.amount:,} {each.unit}")
        self.update(Group(head, lines))


Display = Lines | Bar
"""Shows what the runner does."""


def display() -> Display:
    """A bar where somebody can see it move, lines elsewhere."""
    return Bar(Console()) if sys.stdout.isatty() else Lines()


class TimeLeft:
    """Of runs that are made some at a time, the longest first.

    Args:
        expected: Seconds of each run where kept times were made, by its id, in the order in which they begin.
        at_once: How many runs are made at a time; None where that shows by and by.
        now: Tells the time in seconds.
    """

    def __init__(
        self, expected: dict[str, float], at_once: int | None, now: Callable[[], float] = time.monotonic
    ):
        self._expected, self._at_once, self._now = expected, at_once, now
        self._begun: dict[str, tuple[float, float]] = {}
        self._over: list[tuple[float, float]] = []

    def has_made(self, run: str, share: float) -> None:
        """A run has made this share of its work; it begins with the first call."""
        since, _ = self._begun.get(run, (self._now(), 0.0))
        self._begun[run] = since, share

    def ends(self, run: str, took: float | None) -> None:
        """A run is over, after so many seconds; None where that tells nothing of others."""
        expected = self._expected.pop(run)
        self._begun.pop(run, None)
        if took is not None:
            self._over.append((expected, took))

    def seconds(self) -> float:
        """Until all runs are over."""
        made, left = [*self._over], []
        for run, expected in self._expected.items():
            since, share = self._begun.get(run, (0.0, 0.0))
            left.append((1 - share) * expected)
            if share:
                made.append((share * expected, self._now() - since))
        return _pace(made) * _one_after_the_other(left, self._at_once or max(len(self._begun), 1))


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


@dataclass(frozen=True, slots=True)
class Status:
    """The runs of a suite; how many are in which state; what the user typed; whether any has failed."""

    runs: pd.DataFrame
    counts: str
    command: str
    failed: bool


def status(out: Path) -> Status:
    """The state of all runs of the suite that was run in a folder last.

    Raises:
        ConfigError: No suite was run there.
    """
    suite, command = read_suite(out)
    runner = at_work(out)
    rows = [(run.id, *_state(run, out, runner)) for run in runs_of(suite)]
    states = [state for _, state, _ in rows]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    counts = f"{len(rows)} runs: {counts}; {'a runner is' if runner else 'no runner is'} at work"
    return Status(pd.DataFrame(rows, columns=["run", "state", "detail"]), counts, command, "failed" in states)


def _state(run: Run, out: Path, runner: bool) -> tuple[str, str]:
    amount, of = run.work
    folder = folder_of(out, run.id)
    if is_done(folder):
        return "done", f"{amount:,} {of}"
    if (folder / FAILED).exists():
        failure = read_json(folder / FAILED)
        last = failure["log_tail"][-1] if failure["log_tail"] else "it printed nothing"
        return "failed", f"exit code {failure['exit_code']}: {last} ({folder / LOG})"
    begun = newest_folder(pending_of(out, run.id)) or folder
    if not (begun / RUN).exists():
        return "waiting", ""
    made = f"{made_in(begun):,} of {amount:,} {of}"
    return ("running", made) if runner else ("interrupted", f"after {made}; begins anew")
