"""How surely pegs are put into holes, by clearance: success, motions, and forces on the plate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
from calfree_gym import MOUNTS
from experiments.reporting.tables import Table, beside
from experiments.statistics import mean_share
from experiments.studies.common import first_trials

INSERT = "calfree_gym:CalFree/Insert-v0"
FIRST_WORLD, WORLDS = 40_000, 100
"""Wild worlds that nobody tuned on."""
CLEARANCES = (0.5, 1.0, 2.0, 3.0, 5.0)
"""In mm."""
ASKED, ASKED_OF = 2.0, 0.90
"""At this clearance (mm) so many pegs are to go in."""
MOST_FORCE = 20.0
"""95 % of insertions are to press on the plate with no more (N)."""


def tables(worlds: int = WORLDS, clearances: tuple[float, ...] = CLEARANCES) -> Iterator[Table]:
    """First trials of agents that insert, in wild worlds: by clearance (mm), and on the other mount."""
    kinds = [(MOUNTS[0], each) for each in clearances] + [(MOUNTS[1], ASKED)]
    names = [name for name in agents.names("insert") if name != "random"]
    rows = [_row(name, mount, clearance, worlds) for name in names for mount, clearance in kinds]
    formats = {
        "clearance mm": "g",
        "success": ".0%",
        "required": ".0%",
        "told": ".0%",
        "motions": ".0f",
        "force N": ".1f",
        "required N": ".0f",
    }
    note = (
        f"Wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, one first trial each, 0.5 px noise, at most "
        "60 motions; success by the truth: 10 mm deep in the hole. Told: images tell it, which ends the "
        "trial. Brackets: 95 % intervals over worlds. Motions: median. Force: of gripper and peg on the "
        "plate, the largest of a trial, 95th percentile of trials."
    )
    yield Table("insert", "A peg into a hole", pd.DataFrame(rows), formats, note)


def _row(name: str, mount: str, clearance: float, worlds: int) -> dict[str, Any]:
    env = gym.make(INSERT, camera_mount=mount, clearance=clearance, disable_env_checker=True)
    trials = first_trials(name, env, range(FIRST_WORLD, FIRST_WORLD + worlds))
    return {
        "agent": name,
        "mount": mount,
        "clearance mm": clearance,
        "worlds": worlds,
        **beside("success", mean_share(np.array([[trial.success] for trial in trials])), ".0%"),
        "required": ASKED_OF if clearance == ASKED else None,
        "told": np.mean([trial.told for trial in trials]),
        "motions": np.median([trial.motions for trial in trials]),
        "force N": np.percentile([trial.infos[-1]["truth"]["force"] for trial in trials], 95),
        "required N": MOST_FORCE,
    }
