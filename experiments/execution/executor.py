"""The seam between a suite and the machines that carry it out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol


class Executor(Protocol):
    """Makes attempts at runs, somewhere, some at a time: each one is a call of `attempt.attempt`.

    Only paths of orders (see `orders`) go there and only exit codes come back; everything else stands in
    files, so that all machines must see the results folder under the same path.
    """

    def start(self, orders: Sequence[Path]) -> None:
        """Lets one attempt at each order begin as soon as there is room for it."""

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """Waits for an attempt to end, at most so long.

        Returns:
            The order of each attempt that has ended since, and the exit code of its body: 0 where the run is
            in its place, above 0 where its body failed, below 0 where it was lost: killed by that signal, or
            gone with its machine (`attempt.LOST`).

        Raises:
            ConfigError: The machines cannot be reached any more, or do not see the folder.
            OSError: The folder cannot be written.
        """

    def close(self) -> None:
        """Leaves the machines, where all orders have been withdrawn or are done; may be called twice."""
