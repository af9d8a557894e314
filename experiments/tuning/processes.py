"""The processes in which settings are tried."""

import subprocess
import threading
from collections.abc import Generator
from pathlib import Path

from experiments.running.process import start_module
from experiments.running.run import LifetimeRun
from experiments.tuning.worker import OVER_BUDGET, Report, Request


class OverBudgetError(Exception):
    """CPU time ran out."""


class LostError(Exception):
    """A process was stopped, or died: nothing follows about its settings."""


class Processes:
    """Starts worker processes, several at a time from several threads, and ends them all where asked."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def reports(
        self, runs: tuple[LifetimeRun, ...], cpu_seconds: float | None, log: Path
    ) -> Generator[Report, None, None]:
        """Makes lifetimes in a fresh process with one thread; closed early, it ends the process.

        Args:
            runs: The lifetimes.
            cpu_seconds: The CPU time that they may take; None: any.
            log: What they print is appended to this file.

        Yields:
            A report after each lifetime.

        Raises:
            OverBudgetError: They took longer.
            LostError: The process was stopped, or died.
        """
        process = self._start(log)
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            request = Request(runs=runs, cpu_seconds=cpu_seconds)
            process.stdin.write(request.model_dump_json() + "\n")
            process.stdin.flush()
            for line in process.stdout:
                yield Report.model_validate_json(line)
            code = process.wait()
            if code == OVER_BUDGET:
                raise OverBudgetError
            if code:
                raise LostError(f"its process ended with exit code {code}; see {log}")
        finally:
            process.kill()
            process.wait()
            with self._lock:
                self._running.discard(process)

    def stop(self) -> None:
        """Ends all processes, and starts no more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()

    def _start(self, log: Path) -> subprocess.Popen[str]:
        with self._lock, log.open("a", encoding="utf-8") as file:
            if self._stopped:
                raise LostError("stopped")
            process = start_module("experiments.tuning.worker", errors=file)
            self._running.add(process)
        return process
