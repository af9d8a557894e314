"""Carrying out a suite: a fresh process a run, finished runs skipped, one crash fails one run."""

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from experiments import worker
from experiments.config import Suite
from experiments.plan import RunSpec, runs_of
from experiments.progress import Display
from experiments.versions import REPOSITORY, versions

FAILED = "FAILED.json"
SUITE = "suite.json"
VERSIONS = "versions.json"
LOG = "log.txt"

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


class Runner:
    """Carries out the runs of one suite into one folder."""

    def __init__(self, suite: Suite, out: Path, display: Display):
        self._suite = suite
        self._out = out
        self._display = display
        self._versions = versions()
        self._processes: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(self, jobs: int, command: str) -> list[str]:
        """Makes all runs that are not finished yet.

        Args:
            jobs: How many runs to make at a time.
            command: What the user typed, for the report.

        Returns:
            The ids of the runs that failed.
        """
        runs = runs_of(self._suite)
        self._out.mkdir(parents=True, exist_ok=True)
        about = {"suite": self._suite.model_dump(mode="json"), "command": command}
        (self._out / SUITE).write_text(json.dumps(about, indent=2), encoding="utf-8")
        pending = [spec for spec in runs if not self._is_finished(spec)]
        self._display.say(f"{len(runs)} runs, {len(runs) - len(pending)} of them finished already")
        pool = ThreadPoolExecutor(jobs)
        try:
            list(pool.map(self._run_one, pending))
        except BaseException:
            self._stop()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
        return [spec.id for spec in runs if not is_done(folder_of(self._out, spec.id))]

    def _is_finished(self, spec: RunSpec) -> bool:
        """Whether this very code has finished the run; what other code finished is set aside."""
        folder = folder_of(self._out, spec.id)
        if not is_done(folder):
            return False
        made_by = json.loads((folder / VERSIONS).read_text(encoding="utf-8"))
        if made_by == self._versions:
            return True
        aside = self._out / "stale" / f"{spec.id}-{made_by['code']}"
        different = [key for key in self._versions if made_by.get(key) != self._versions[key]]
        self._display.say(
            f"{spec.id}: finished with other versions of {', '.join(different)}; "
            f"kept in {aside}, and made again"
        )
        shutil.rmtree(aside, ignore_errors=True)
        aside.parent.mkdir(exist_ok=True)
        folder.rename(aside)
        return False

    def _run_one(self, spec: RunSpec) -> None:
        folder = folder_of(self._out, spec.id)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / worker.SPEC).write_text(spec.model_dump_json(indent=2), encoding="utf-8")
        (folder / VERSIONS).write_text(json.dumps(self._versions, indent=2), encoding="utf-8")
        self._display.start(spec.id, spec.scenario.motions)
        start = time.monotonic()
        exit_code = self._follow(spec.id, folder)
        wall = f"{time.monotonic() - start:.0f} s"
        if self._stopped:
            return
        if exit_code == 0 and is_done(folder):
            self._display.end(spec.id, f"done in {wall}")
            return
        lines = (folder / LOG).read_text(encoding="utf-8").splitlines()
        failure: dict[str, Any] = {"exit_code": exit_code, "log_tail": lines[-20:]}
        (folder / FAILED).write_text(json.dumps(failure, indent=2), encoding="utf-8")
        tail = "\n".join(f"    {line}" for line in failure["log_tail"])
        self._display.end(
            spec.id, f"FAILED after {wall}, exit code {exit_code}:\n{tail}\n    ({folder / LOG})"
        )

    def _follow(self, run: str, folder: Path) -> int:
        """Makes a run in a process of its own, and passes on what it prints."""
        with self._lock:
            if self._stopped:
                return -1
            process = subprocess.Popen(
                [sys.executable, "-m", "experiments.worker", str(folder.resolve())],
                cwd=REPOSITORY,
                env={**os.environ, **_ONE_THREAD, "PYTHONHASHSEED": "0"},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            )
            self._processes.add(process)
        assert process.stdout is not None
        with (folder / LOG).open("w", encoding="utf-8") as log:
            for line in process.stdout:
                log.write(line)
                log.flush()
                self._display.line(run, line)
        exit_code = process.wait()
        with self._lock:
            self._processes.discard(process)
        return exit_code

    def _stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in self._processes:
                process.terminate()


def folder_of(out: Path, run: str) -> Path:
    """Where a run keeps what it makes."""
    return out / "runs" / run


def is_done(folder: Path) -> bool:
    """Whether a run has finished."""
    return (folder / worker.DONE).exists()
