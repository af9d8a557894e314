"""How surely `grasp` picks things up at once, by shape, by mount, and by how they are seen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd

from calfree_gym import MOUNTS
from calfree_gym.robot.grasping.shapes import SHAPE_NAMES
from experiments.benchmarks.contact.first_trial import first_trials, success_of
from experiments.reporting.tables import Table

GRASP = "calfree_gym:CalFree/Grasp-v0"
FIRST_WORLD = 90_000
"""Wild worlds that nobody tuned on."""
WORLDS = {"points": 100, "vision": 30}
"""By observation: images take ten times as long."""


def first_grasps(worlds: Mapping[str, int] = WORLDS) -> Iterator[Table]:
    """First trials of an agent that knows nothing, one in each world.

    Args:
        worlds: How many, by observation.
    """
    rows = [_row(*each, worlds[each[0]]) for each in product(worlds, SHAPE_NAMES, MOUNTS)]
    formats = {"success": ".0%", "told": ".0%", "motions": ".0f", "motions, 95th percentile": ".0f"}
    note = (
        f"Wild worlds from {FIRST_WORLD} on, things on the table, one first trial each, at most 60 motions. "
        "Points have 0.5 px of noise; vision: images, found by their colours. Success by the truth: lifted "
        "by 50 mm. Told: images tell it, which ends the trial. Brackets: 95 % intervals over worlds. "
        "Motions: median, those of failures counted."
    )
    yield Table("first_grasps", "First grasps", pd.DataFrame(rows), formats, note)


def _row(observation: str, shape: str, mount: str, worlds: int) -> dict[str, Any]:
    env = gym.make(GRASP, shape=shape, camera_mount=mount, observation=observation, disable_env_checker=True)
    trials = first_trials("grasp", env, range(FIRST_WORLD, FIRST_WORLD + worlds))
    motions = [trial.motions for trial in trials]
    return {
        "observation": observation,
        "shape": shape,
        "mount": mount,
        "worlds": worlds,
        **success_of(trials),
        "told": np.mean([trial.told for trial in trials]),
        "motions": np.median(motions),
        "motions, 95th percentile": np.percentile(motions, 95),
    }
