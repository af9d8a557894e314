"""Results that nobody made: lives of several agents, whose curves are known."""

from pathlib import Path

import numpy as np
import pandas as pd

from experiments.config.suite import Suite
from experiments.reporting.finished_suite import FinishedSuite
from experiments.running.run import runs_of

CAP = 60
# Motions of a life; motions per reach at first, right after the knock and in the end; and by how many motions
# half of the way is learned.
LIVES = {
    "oracle": (2_000, 1, 1, 1, 1),
    "paper_servo": (2_000, 10, 10, 10, 1),
    "grid_table": (2_000, 10, 9.5, 4, 700),
    "memory": (2_000, 6.7, 3, 1, 30),
    "cooperstock_milios": (2_000, 60, 11, 1.1, 40),
    "self_supervised": (2_000, 60, 3.6, 1, 50),
    "ppo": (300_032, 60, 45, 1.9, 12_000),
    "sac": (16_000, 60, 50, 1.6, 3_500),
    "random": (2_000, 58, 58, 58, 1),
}


def finished_lives(worlds: int, out: Path, knock: bool = True, agents: tuple[str, ...] = ()) -> FinishedSuite:
    """A suite in which the left camera is turned at half of each life, or is not."""
    half = 1_000
    event = {"at": {"motion": half}, "do": {"type": "camera_aim", "camera": "left", "degrees": 20}}
    suite = Suite.model_validate(
        {
            "name": "lives",
            "question": "Who learns?",
            "worlds": worlds,
            "scenarios": [
                {
                    "name": "knocked",
                    "env": {
                        "id": "CalFree/ReachDense-v0",
                        "world": "wild",
                        "camera_mount": "waist",
                        "dynamics": "kinematic",
                        "max_episode_steps": CAP,
                    },
                    "motions": 2 * half,
                    "perturbations": [event] if knock else [],
                }
            ],
            "evaluation": {"every": 10, "trials": 2},
            "agents": list(agents or LIVES),
        }
    )
    rows = [row for agent in agents or LIVES for world in range(worlds) for row in _life(agent, world, knock)]
    columns = [
        "agent", "world", "lifetime_motions", "motions_since_perturbation", "motions", "rendezvous",
    ]  # fmt: skip
    results = pd.DataFrame(rows, columns=columns).assign(scenario="knocked", phase="eval", trial=0)
    results["motions_since_perturbation"] = results["motions_since_perturbation"].astype("Int64")
    results["success"] = results["rendezvous"]
    runs = runs_of(suite)
    outcomes = {run.id: {"privileged": [], "prior_knowledge": [], "perturbations": []} for run in runs}
    return FinishedSuite(out, suite, "", runs, outcomes, {}, {}, results, pd.DataFrame())


def checkpoints(length: int) -> list[int]:
    """0, 1, then four a decade, and the end."""
    found = np.unique(np.round(10 ** np.arange(0, np.log10(length), 0.25)).astype(int))
    return [0, *found.tolist(), length]


def _life(agent: str, world: int, knock: bool) -> list[tuple[object, ...]]:
    length, first, after, last, by = LIVES[agent]
    wide = 1 + 0.15 * np.sin(world + 1) * (first != last)

    def reach(start: float, motions: int) -> float:
        return float(np.clip(last + (start * wide - last) * 2 ** (-motions / by), 1, CAP))

    end = length // 2 if knock else length
    rows = [(agent, world, at, None, reach(first, at)) for at in checkpoints(end)]
    if knock:
        rows += [(agent, world, end + at, at, reach(after, at)) for at in checkpoints(length - end)]
    return [(*row, row[-1] < CAP) for row in rows]
