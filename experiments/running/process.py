"""The processes that make results: started in the same way on every machine."""

import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from experiments.running.versions import REPOSITORY

ENDED = "\0ended "
"""In what a worker prints: before the exit code of a run that is over."""
OVER_BUDGET = 75
"""The exit code of a run whose CPU time ran out."""
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


def _import_path() -> str:
    """Where this process finds modules, from whatever folder."""
    return os.pathsep.join(str(Path(each).absolute()) for each in sys.path)


class Worker:
    """A process that has imported what a run needs, and makes each run in a copy of itself, one at a time.

    It ends, and the copy with it, when the process that started it ends.
    """

    def __init__(self, versions: Mapping[str, str]):
        self.versions = versions
        self._process = subprocess.Popen(
            [sys.executable, "-m", "experiments.running.worker"],
            cwd=REPOSITORY,
            env={**os.environ, **_ONE_THREAD, "PYTHONHASHSEED": "0", "PYTHONPATH": _import_path()},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # so that an interrupt reaches its parent alone
            text=True,
            errors="replace",
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout

    @property
    def is_alive(self) -> bool:
        """Whether it can make another run."""
        return self._process.poll() is None and not self._input.closed

    def make(self, folder: Path, log: IO[str], cpu_seconds: float = math.inf) -> int:
        """Makes the run that `folder` describes, and writes what is printed, errors too, into `log`.

        Returns the exit code of the copy, or of the worker itself where that has ended.
        """
        with suppress(BrokenPipeError):
            self._input.write(f"{cpu_seconds} {folder.resolve()}\n")
            self._input.flush()
        for line in self._output:
            printed, ended, exit_code = line.partition(ENDED)
            log.write(printed)
            log.flush()
            if ended:
                return int(exit_code)
        return self._process.wait()

    def kill(self) -> None:
        """Ends it; the copy ends as its input does."""
        self._process.kill()
        with suppress(BrokenPipeError):
            self._input.close()

    def end(self) -> None:
        """Ends it, and waits until it has ended."""
        self.kill()
        with self._process:
            pass


_idle: list[Worker] = []


@contextmanager
def lent_worker(versions: Mapping[str, str]) -> Iterator[Worker]:
    """A worker made of these versions, to make one run: one that has made others, or a new one."""
    lent = _idle_of(versions) or Worker(versions)
    try:
        yield lent
    except BaseException:
        lent.end()
        raise
    if lent.is_alive:
        _idle.append(lent)
    else:
        lent.end()


def _idle_of(versions: Mapping[str, str]) -> Worker | None:
    """An idle one; those made of other versions are ended."""
    with suppress(IndexError):  # several threads take from the same list
        while (found := _idle.pop()).versions != versions:
            found.end()
        return found
    return None


def end_idle_workers() -> None:
    """Ends those that make no run."""
    with suppress(IndexError):
        while True:
            _idle.pop().end()
