"""Carrying out a suite: a fresh process a run, finished runs skipped, one crash fails one run."""

import os
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from experiments.config.suite import Suite
from experiments.running.plan import Run, runs_of
from experiments.running.progress import Display
from experiments.running.results_folder import (
    FAILED,
    LOG,
    SPEC,
    SUITE,
    VERSIONS,
    folder_of,
    is_done,
    locked,
    refuse_foreign,
    write_json,
    write_whole,
)
from experiments.running.versions import REPOSITORY, commit, versions

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


class Runner:
    """Carries out the runs of one suite into one folder.

    A worker ends with its runner, however that ends: a restarted one waits until the folder is free.

    Args:
        suite: What to run.
        out: The folder.
        display: Shows what happens.
        fail_fast: Whether the first failed run stops the others.
    """

    def __init__(self, suite: Suite, out: Path, display: Display, fail_fast: bool = False):
        self._suite = suite
        self._out = out
        self._display = display
        self._fail_fast = fail_fast
        self._versions = versions()
        self._processes: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = threading.Event()

    def run(self, jobs: int, command: str) -> list[str]:
        """Makes all runs that are not finished yet.

        Args:
            jobs: How many runs to make at a time.
            command: What the user typed, for the report.

        Returns:
            The ids of the runs that failed, or that a failed one stopped.

        Raises:
            ConfigError: Another runner is at work in the folder, or results of other code or of another
                configuration are there.
            OSError: The folder cannot be written; what has finished stays.
        """
        runs = runs_of(self._suite)
        self._out.mkdir(parents=True, exist_ok=True)
        with locked(self._out) as self._inherited:
            refuse_foreign(self._out, self._suite, self._versions)
            about = {"suite": self._suite.model_dump(mode="json"), "command": command, "commit": commit()}
            write_json(self._out / SUITE, about)
            pending = [spec for spec in runs if not is_done(folder_of(self._out, spec.id))]
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

    def _run_one(self, spec: Run) -> None:
        if self._stopped.is_set():
            return
        folder = folder_of(self._out, spec.id)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        write_whole(folder / SPEC, spec.model_dump_json(indent=2))
        write_json(folder / VERSIONS, self._versions)
        self._display.start(spec.id, *spec.work)
        start = time.monotonic()
        exit_code = self._follow(spec.id, folder)
        wall = f"{time.monotonic() - start:.0f} s"
        if exit_code == 0 and is_done(folder):
            self._display.end(spec.id, f"done in {wall}")
            return
        if self._stopped.is_set():
            self._display.end(spec.id, f"stopped after {wall}")
            return
        lines = (folder / LOG).read_text(encoding="utf-8").splitlines()[-20:]
        write_json(folder / FAILED, {"exit_code": exit_code, "log_tail": lines})
        tail = "\n".join(f"    {line}" for line in lines)
        self._display.end(
            spec.id, f"FAILED after {wall}, exit code {exit_code}:\n{tail}\n    ({folder / LOG})"
        )
        if self._fail_fast:
            self._stop()

    def _follow(self, run: str, folder: Path) -> int:
        """Makes a run in a process of its own, and passes on what it prints."""
        with self._lock:
            if self._stopped.is_set():
                return -1
            process = subprocess.Popen(
                [sys.executable, "-m", "experiments.running.worker", str(folder.resolve())],
                cwd=REPOSITORY,
                env={**os.environ, **_ONE_THREAD, "PYTHONHASHSEED": "0"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=(self._inherited,) if os.name == "posix" else (),
                text=True,
                errors="replace",
            )
            self._processes.add(process)
        assert process.stdout is not None
        try:
            with (folder / LOG).open("w", encoding="utf-8") as log:
                for line in process.stdout:
                    log.write(line)
                    log.flush()
                    self._display.line(run, line)
            exit_code = process.wait()
        except BaseException:
            process.kill()
            raise
        finally:
            with self._lock:
                self._processes.discard(process)
        return exit_code

    def _stop(self) -> None:
        with self._lock:
            self._stopped.set()
            for process in self._processes:
                process.terminate()
