"""Runs made on this machine."""

from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path

from experiments.execution.attempt import attempt
from experiments.running.body import end_templates


class Local:
    """See `Executor`.

    Args:
        jobs: How many attempts to make at a time.
    """

    def __init__(self, jobs: int):
        self._pool = ThreadPoolExecutor(jobs)
        self._attempts: dict[Future[int], Path] = {}

    def start(self, orders: Sequence[Path]) -> None:
        """See `Executor`."""
        for order in orders:
            self._attempts[self._pool.submit(attempt, str(order))] = order

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """See `Executor`."""
        over, _ = wait(self._attempts, seconds, FIRST_COMPLETED)
        return [(self._attempts.pop(future), future.result()) for future in over]

    def close(self) -> None:
        """See `Executor`: waits until the last body has ended."""
        self._pool.shutdown(cancel_futures=True)
        end_templates()
