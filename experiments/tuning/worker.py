"""Some lifetimes in a process of their own, told on its input: `python -m experiments.tuning.worker`."""

import json
import os
import sys
import threading
import time
import traceback
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.config.model import Model
from experiments.running.cpu_time import CpuTimes
from experiments.running.results_folder import TRIALS
from experiments.running.run import LifetimeRun
from experiments.running.worker import end_with_the_parent, run_lifetime


def motions_per_reach(run: LifetimeRun) -> float:
    """Motions of a held-out reach, mean over all checkpoints of a lifetime.

    A trial without a rendezvous counts as the cap. So it counts how much an agent knows in the end, how soon
    it knew it, and what a change of the world costs it.
    """
    with TemporaryDirectory() as folder:
        run_lifetime(run, Path(folder), CpuTimes())
        lines = (Path(folder) / TRIALS).read_text(encoding="utf-8").splitlines()
    trials = [trial for trial in map(json.loads, lines) if trial["phase"] == "eval"]
    cap = run.scenario.env.max_episode_steps
    return float(np.mean([trial["motions"] if trial["rendezvous"] else cap for trial in trials]))


OVER_BUDGET = 75
"""Exit code where CPU time ran out."""


class Request(Model):
    """What a worker reads from the first line of its input.

    Attributes:
        runs: The lifetimes to make, one after the other.
        cpu_seconds: The CPU time that it may take, that of starting included; None: any.
    """

    runs: tuple[LifetimeRun, ...]
    cpu_seconds: float | None


class Report(Model):
    """What a worker writes after each lifetime, on a line: its value, or its error.

    Attributes:
        value: Of the objective.
        error: What it failed with.
        cpu_seconds: Of the process up to now, user and system.
    """

    value: float | None = None
    error: str | None = None
    cpu_seconds: float


def main() -> None:
    """Makes the lifetimes, and reports each; all that they print goes where errors go."""
    request = Request.model_validate_json(sys.stdin.readline())
    threading.Thread(target=end_with_the_parent, daemon=True).start()
    if request.cpu_seconds is not None:
        threading.Thread(target=_end_after, args=(request.cpu_seconds,), daemon=True).start()
    out = sys.stdout
    with redirect_stdout(sys.stderr):
        for run in request.runs:
            print(_report(run).model_dump_json(), file=out, flush=True)


def _report(run: LifetimeRun) -> Report:
    """Makes a lifetime."""
    value, failed = None, None
    try:
        value = motions_per_reach(run)
    except Exception as error:  # whatever an agent raises with these settings
        traceback.print_exc()
        failed = f"{type(error).__name__}: {error}"
    return Report(value=value, error=failed, cpu_seconds=time.process_time())


def _end_after(cpu_seconds: float) -> None:
    while (left := cpu_seconds - time.process_time()) > 0:
        time.sleep(left)  # it has one thread that works: CPU time does not pass faster
    os._exit(OVER_BUDGET)


if __name__ == "__main__":
    main()
