"""Showing how far the runs are: bars on a terminal, plain lines elsewhere."""

import os
import re
import sys
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

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

    def start(self, run: str, amount: int, of: str) -> None:
        """A run begins its work: this many motions, or trials."""

    def made(self, run: str, amount: int) -> None:
        """A run has done so much of its work."""

    def end(self, run: str, outcome: str) -> None:
        """A run is over."""


class Lines:
    """Plain lines: the beginning and the end of each run."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        pass

    def say(self, text: str) -> None:
        """Prints a line."""
        print(text, flush=True)

    def start(self, run: str, amount: int, of: str) -> None:
        """Says that a run begins."""
        self.say(f"{run}: started, {amount:,} {of}")

    def made(self, run: str, amount: int) -> None:
        """Keeps quiet: the run's log tells it."""

    def end(self, run: str, outcome: str) -> None:
        """Says how a run ended."""
        self.say(f"{run}: {outcome}")


class Bars:
    """A bar for each run under way."""

    def __init__(self, console: Console):
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:,.0f} of {task.total:,.0f} {task.fields[of]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
        )
        self._bars = {}  # type: ignore[var-annotated]  # rich's TaskID is private to it

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        self._progress.stop()

    def say(self, text: str) -> None:
        """Prints a line above the bars."""
        self._progress.console.print(text, markup=False, highlight=False)

    def start(self, run: str, amount: int, of: str) -> None:
        """Adds a bar."""
        self._bars[run] = self._progress.add_task(run, total=amount, of=of)

    def made(self, run: str, amount: int) -> None:
        """Moves a bar."""
        self._progress.update(self._bars[run], completed=amount)

    def end(self, run: str, outcome: str) -> None:
        """Turns a bar into a line."""
        self._progress.remove_task(self._bars.pop(run))
        self.say(f"{run}: {outcome}")


def display() -> Display:
    """Bars where somebody can see them move, lines elsewhere."""
    return Bars(Console()) if sys.stdout.isatty() else Lines()
