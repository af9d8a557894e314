"""Showing how far the runs are: bars on a terminal, plain lines elsewhere."""

import re
import sys
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

_DONE = re.compile(r"^(?:motions|trials) (\d+)/")


def done_by(line: str) -> int | None:
    """How much of its work a run has done when it prints a line, if the line says so."""
    match = _DONE.match(line)
    return int(match[1]) if match else None


class Display(Protocol):
    """Shows what the runner does; safe to call from several threads."""

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

    def line(self, run: str, line: str) -> None:
        """A run has printed a line."""

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

    def line(self, run: str, line: str) -> None:
        """Keeps quiet: the run's log has its lines."""

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

    def line(self, run: str, line: str) -> None:
        """Moves a bar, if the line says how far the run is."""
        if (done := done_by(line)) is not None:
            self._progress.update(self._bars[run], completed=done)

    def end(self, run: str, outcome: str) -> None:
        """Turns a bar into a line."""
        self._progress.remove_task(self._bars.pop(run))
        self.say(f"{run}: {outcome}")


def display() -> Display:
    """Bars where somebody can see them move, lines elsewhere."""
    return Bars(Console()) if sys.stdout.isatty() else Lines()
