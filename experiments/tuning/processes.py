"""The processes in which settings are tried."""

import os
import subprocess
import sys
import threading
from collections.abc import Generator
from pathlib import Path

from experiments.running.plan import LifetimeRun
from experiments.running.versions import REPOSITORY
from experiments.tuning.worker import OVER_BUDGET, Report, Request

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


class OverBudgetError(Exception):
    """CPU time ran out."""


class LostError(Exception):
    """A process was stopped, or died: nothing follows about its settings."""


class Processes:
    """Starts worker processes, several at a time from several threads, and ends them all where asked.

    Args:
        inherited: Descriptor of the lock of the results folder: it lasts until the last of them has ended.
    """

    def __init__(self, inherited: int):
        self._inherited = inherited
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
            process = subprocess.Popen(
                [sys.executable, "-m", "experiments.tuning.worker"],
                cwd=REPOSITORY,
                env={**os.environ, **_ONE_THREAD, "PYTHONHASHSEED": "0"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                pass_fds=(self._inherited,) if os.name == "posix" else (),
                start_new_session=True,  # so that an interrupt reaches its parent alone
                text=True,
            )
            self._running.add(process)
        return process
