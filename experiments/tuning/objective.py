"""What tuning makes small: one number for a lifetime, the same for all agents."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.running.cpu_time import CpuTimes
from experiments.running.run import LifetimeRun
from experiments.running.trial_log import TRIALS
from experiments.running.worker import run_lifetime


def motions_per_reach(run: LifetimeRun) -> float:
    """Motions of a held-out reach, mean over all checkpoints of a lifetime.

    A trial without a rendezvous counts as the cap. So it counts how much an agent knows in the end, how soon
    it knew it, and what a change of the world costs it.

    Args:
        run: The lifetime, made as in a suite.
    """
    with TemporaryDirectory() as folder:
        run_lifetime(run, Path(folder), CpuTimes())
        lines = (Path(folder) / TRIALS).read_text(encoding="utf-8").splitlines()
    trials = [trial for trial in map(json.loads, lines) if trial["phase"] == "eval"]
    cap = run.scenario.env.max_episode_steps
    return float(np.mean([trial["motions"] if trial["rendezvous"] else cap for trial in trials]))
