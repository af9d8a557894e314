"""Showing how far the runs are: a bar on a terminal, plain lines elsewhere."""

import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from experiments.execution.progress.time_left import in_words
from experiments.running.results_folder import LOG

_DONE = re.compile(r"^(?:motions|trials) (\d+)/", re.MULTILINE)
_TAIL = 10_000
"""Bytes at the end of a log in which a line of progress is looked for."""


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
    """A run under way.

    Attributes:
        what: The run, in words.
        made: How much of its work is done.
        amount: Of how much.
        unit: "motions" or "trials".
    """

    what: str
    made: int
    amount: int
    unit: str


@dataclass(frozen=True, slots=True)
class Standing:
    """How far a suite is.

    Attributes:
        over: Runs that are over.
        runs: All runs.
        left: Seconds that the others will take, about.
        at_work: Runs under way.
    """

    over: int
    runs: int
    left: float
    at_work: tuple[AtWork, ...]

    def __str__(self) -> str:
        left = f", about {in_words(self.left)} left" if self.over < self.runs else ""
        return f"{self.over} of {self.runs}{left}"


class Display(Protocol):
    """Shows what the runner does."""

    def __enter__(self) -> Self:
        """Begins to show."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stops showing."""

    def say(self, text: str) -> None:
        """Shows a line that stays."""

    def show(self, now: Standing) -> None:
        """Shows how far the suite is."""


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


class Bar:
    """A bar for the suite, and below it a line for each run under way."""

    def __init__(self, console: Console):
        self._live = Live(console=console, refresh_per_second=4, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        self._live.stop()

    def say(self, text: str) -> None:
        """Prints a line above the bar."""
        self._live.console.print(text, markup=False, highlight=False)

    def show(self, now: Standing) -> None:
        """Moves the bar by whole runs and what is made of those under way."""
        made = now.over + sum(each.made / each.amount for each in now.at_work)
        head = Table.grid(padding=(0, 1))
        head.add_row(ProgressBar(total=now.runs, completed=made, width=40), str(now))
        lines = Table.grid(padding=(0, 2))
        for each in now.at_work:
            lines.add_row(f"  {each.what}", f"{each.made:,} of {each.amount:,} {each.unit}")
        self._live.update(Group(head, lines))


def display() -> Display:
    """A bar where somebody can see it move, lines elsewhere."""
    return Bar(Console()) if sys.stdout.isatty() else Lines()
