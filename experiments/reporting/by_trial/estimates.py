"""From results.parquet to lifetimes counted in trials, in blocks of trials."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, SECONDS, SUCCESS
from experiments.reporting.statistics import Array, Estimate, bootstrap_band

FINE = (1, 5, 10, 25, 50, 100, 150, 200, 300, 400, 500, 1_000, 2_000, 5_000)
COARSE = (25, 50, 100, 150, 300, 400, 500, 1_000, 2_000, 5_000)
"""After how many trials a block ends, counted from the last event."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """One measure of one agent in blocks of trials, over its runs.

    Attributes:
        edges: Trials that have gone at the first block's beginning and at every block's end (blocks + 1,).
        runs: The measure's mean over each block, in each run (runs, blocks).
    """

    edges: Array
    runs: Array

    def estimates(self) -> list[Estimate]:
        """Each block's mean over runs, with the 95 % bootstrap over whole runs."""
        mean = self.runs.mean(axis=0)
        low, high = bootstrap_band(
            self.runs, lambda runs: np.asarray(runs.mean(axis=0)), np.random.default_rng(0)
        )
        return [Estimate(*map(float, edges)) for edges in zip(mean, low, high, strict=True)]


def edges_of(scenario: ScenarioConfig, ends: Sequence[int]) -> Array:
    """Where blocks of trials begin and end: `ends` after the beginning and each `at: {trial: n}`."""
    trials, _ = scenario.length
    events = {e["at"]["trial"] for e in scenario.perturbations if "trial" in e.get("at", {})}
    found = {trials}
    for start, stop in pairwise(sorted({0, trials, *events})):
        found |= {start, *(start + end for end in ends if start + end < stop)}
    return np.array(sorted(found), float)


def trial_costs(rows: pd.DataFrame, scenario: ScenarioConfig) -> pd.DataFrame:
    """The agents' own trials, of the rows of `with_cost`, in robot seconds per reach too.

    A failed trial counts as going on to the cap at its own pace.
    """
    mine = rows[rows["phase"] == "train"].copy()
    to_the_cap = scenario.env.max_episode_steps / mine["motions"]
    mine[SECONDS] = mine[SECONDS] * to_the_cap.where(mine[SUCCESS] == 0, 1.0)
    return mine


def blocks(costs: pd.DataFrame, agent: str, measure: str, worlds: int, edges: Array, cap: int) -> Blocks:
    """A measure's means over blocks of an agent's trials.

    Args:
        costs: What `trial_costs` returned.
        agent: The agent's label.
        measure: SUCCESS, MOTIONS or SECONDS.
        worlds: How many runs there should be; those without any row failed, and are worst throughout: no
            success, `cap` motions, and the seconds of the slowest trial of any agent.
        edges: What `edges_of` returned.
        cap: Motions after which a trial has failed.
    """
    slowest = costs[SECONDS].max() if len(costs) else np.nan
    worst = {SUCCESS: 0.0, MOTIONS: float(cap), SECONDS: float(slowest)}[measure]
    mine = costs[costs["agent"] == agent]
    block = np.searchsorted(edges, mine["trial"], side="right") - 1
    found = mine.pivot_table(index="world", columns=block, values=measure, aggfunc="mean")
    finished = found.reindex(columns=range(len(edges) - 1)).to_numpy(dtype=float)
    failed = np.full((worlds - len(finished), len(edges) - 1), worst)
    return Blocks(edges, np.vstack([finished, failed]))
