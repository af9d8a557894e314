"""The machines that make runs: this one, or those of a Dask cluster (`dask_cluster`)."""

from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Protocol

from experiments.execution.pending import make
from experiments.running.process import end_idle_workers


class Machines(Protocol):
    """Let workers make pending runs, some at a time: each one is a call of `pending.make`.

    Only paths of pending runs go there and only exit codes come back; everything else stands in files, so
    that all machines must see the results folder under the same path.
    """

    def start(self, pending: Sequence[Path]) -> None:
        """Lets a worker begin with each run as soon as there is room for it."""

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """Waits for a worker to end, at most so long.

        Returns:
            The pending run of each worker that has ended since, and its exit code: 0 where the run is in its
            place, above 0 where it failed, below 0 where the worker was lost: killed by that signal, or gone
            with its machine (`pending.LOST`).

        Raises:
            ConfigError: The machines cannot be reached any more, or do not see the folder.
            OSError: The folder cannot be written.
        """

    def close(self) -> None:
        """Leaves the machines, where all runs have been withdrawn or are done; may be called twice."""


class ThisMachine:
    """See `Machines`.

    Args:
        jobs: How many runs to make at a time.
    """

    def __init__(self, jobs: int):
        self._pool = ThreadPoolExecutor(jobs)
        self._working: dict[Future[int], Path] = {}

    def start(self, pending: Sequence[Path]) -> None:
        """See `Machines`."""
        self._working |= {self._pool.submit(make, str(each)): each for each in pending}

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """See `Machines`."""
        over, _ = wait(self._working, seconds, FIRST_COMPLETED)
        return [(self._working.pop(future), future.result()) for future in over]

    def close(self) -> None:
        """See `Machines`: waits until the last worker has ended."""
        self._pool.shutdown(cancel_futures=True)
        end_idle_workers()
