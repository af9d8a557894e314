"""Runs made as jobs of Slurm, started as arrays by submitit."""

import math
import os
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import submitit
from submitit.core.utils import FailedSubmissionError, UncompletedJobError

from experiments.errors import ConfigError
from experiments.execution.attempt import LOST, attempt


def _positive(text: str) -> int:
    if (number := int(text)) < 1:
        raise ValueError
    return number


def _amount(text: str) -> float:
    if not 0 < (number := float(text)) < math.inf:
        raise ValueError
    return number


OPTIONS: dict[str, Callable[[str], Any]] = {
    "account": str,
    "array_parallelism": _positive,
    "cluster": str,
    "comment": str,
    "constraint": str,
    "cpus_per_task": _positive,
    "exclude": str,
    "mem_gb": _amount,
    "nodelist": str,
    "partition": str,
    "qos": str,
    "setup": str,
    "timeout_min": _positive,
}
"""What `--slurm-option` may set, and of which type; `setup` several times. `cluster` is slurm, or local: jobs
of this machine."""
_GENERIC = ("cpus_per_task", "mem_gb", "timeout_min")
_TIMEOUT_MIN = 240
"""Submitit would take 5 minutes, in which few runs end."""
_LARGEST_ARRAY = 1000
"""Jobs of one array: Slurm takes 1,000 unless its `MaxArraySize` says otherwise."""
_OUT_OF_TIME = 124
"""Exit code, as that of the command `timeout`."""
_RESULT_WITHIN = 15.0
"""Seconds in which the result of a job appears on a shared file system; submitit waits as long."""


def parse_options(given: Sequence[str]) -> dict[str, Any]:
    """Reads `key=value`.

    Raises:
        ConfigError: Names what is wrong, and what is allowed.
    """
    found: dict[str, Any] = {}
    for text in given:
        key, _, value = text.partition("=")
        if key not in OPTIONS:
            raise ConfigError(f"--slurm-option {text}: found {key!r}; allowed: {', '.join(OPTIONS)}")
        if key in found and key != "setup":
            raise ConfigError(f"--slurm-option {text}: {key} is given twice")
        try:
            read = OPTIONS[key](value)
            found[key] = [*found.get(key, []), read] if key == "setup" else read
        except ValueError:
            raise ConfigError(
                f"--slurm-option {text}: found {value!r}; must be a number above 0, whole but for mem_gb"
            ) from None
    if (cluster := found.get("cluster", "slurm")) not in ("slurm", "local"):
        raise ConfigError(f"--slurm-option cluster={cluster}: allowed: slurm, local")
    return found


class Slurm:
    """See `Executor`. Orders that are started together are one array of jobs, or several of 1,000.

    Args:
        folder: Where submitit keeps scripts and output of jobs; all machines must see it.
        options: See `OPTIONS`. As jobs of this machine know no queue, `array_parallelism` of them are
            started at a time there (the number of its processors).

    Raises:
        ConfigError: There is no Slurm here.
    """

    def __init__(self, folder: Path, options: dict[str, Any]):
        options = {"cluster": "slurm", "timeout_min": _TIMEOUT_MIN, **options}
        cluster = options.pop("cluster")
        self._here = cluster == "local"
        try:
            self._executor = submitit.AutoExecutor(folder, cluster)
        except RuntimeError as error:
            raise ConfigError(
                f"--slurm: {error} Start it where `sbatch` works; --slurm-option cluster=local makes jobs of "
                "this machine"
            ) from None
        self._executor.update_parameters(
            **{key if key in _GENERIC else f"slurm_{key}": value for key, value in options.items()}
        )
        self._room = options.get("array_parallelism", os.cpu_count()) if self._here else None
        self._waiting: list[Path] = []
        self._jobs: dict[submitit.Job[int], Path] = {}
        self._over: dict[submitit.Job[int], float] = {}

    def start(self, orders: Sequence[Path]) -> None:
        """See `Executor`."""
        self._waiting += orders
        self._submit()

    def _submit(self) -> None:
        room = len(self._waiting) if self._room is None else self._room - len(self._jobs)
        now, self._waiting = self._waiting[:room], self._waiting[room:]
        for begin in range(0, len(now), _LARGEST_ARRAY):
            part = now[begin : begin + _LARGEST_ARRAY]
            try:
                jobs = self._executor.map_array(_attempt_in_job, [str(order.resolve()) for order in part])
            except (FailedSubmissionError, subprocess.CalledProcessError) as error:
                raise ConfigError(
                    f"--slurm: sbatch takes no jobs ({error}). What has finished is kept"
                ) from None
            self._jobs |= dict(zip(jobs, part, strict=True))

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """See `Executor`."""
        until = time.monotonic() + seconds
        while not (over := [job for job in self._jobs if self._is_over(job)]) and time.monotonic() < until:
            time.sleep(seconds / 4)
        found = [(self._jobs.pop(job), _exit_code(job)) for job in over]
        self._submit()
        return found

    def close(self) -> None:
        """See `Executor`."""
        for job in self._jobs:
            job.cancel(check=False)
        self._jobs.clear()
        self._waiting.clear()

    def _is_over(self, job: Any) -> bool:
        """Whether a job has left its result, or will leave none."""
        if not job.done():
            return False
        if self._here or job.paths.result_pickle.exists():
            return True
        return time.monotonic() - self._over.setdefault(job, time.monotonic()) > _RESULT_WITHIN


def _attempt_in_job(order: str) -> int:
    try:
        return attempt(order)
    except UncompletedJobError:  # submitit raises it when the job's time is almost over
        return _OUT_OF_TIME


def _exit_code(job: Any) -> int:
    if not job.paths.result_pickle.exists():
        return LOST
    if (error := job.exception()) is not None:
        raise ConfigError(f"job {job.job_id} cannot make runs: {error}")
    return int(job.result())
