"""From results.parquet to lifetimes counted in trials, in blocks of trials."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from calfree_gym.robot.arms.robot import HINGE_SPEED
from experiments.config.suite import ScenarioConfig
from experiments.evaluation import robot_seconds_at
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SECONDS, SUCCESS
from experiments.statistics import SHARE, Array, Estimate, mean_shares, medians

FINE = (1, 5, 10, 25, 50, 100, 150, 200, 300, 400, 500, 1_000, 2_000, 5_000)
COARSE = (25, 50, 100, 150, 300, 400, 500, 1_000, 2_000, 5_000)
"""After how many trials a block ends, counted from the last event."""
LOOKS = (0.2, 1.0, 4.0)
"""Seconds a look: a camera of today and a fast arm; in between; what the paper's 50 s a grasp come to."""


def seconds_at(look: float) -> str:
    """The measure of robot seconds per reach where a look takes so many seconds."""
    return f"{SECONDS}_at_{look:g}"


@dataclass(frozen=True, slots=True)
class Blocks:
    """One measure of one agent in blocks of trials, over its runs.

    Attributes:
        edges: Trials that have gone at the first block's beginning and at every block's end (blocks + 1,).
        runs: The measure's mean over each block, in the run of each world (worlds, blocks).
        bounds: The lowest and the highest value that a run can have.
    """

    edges: Array
    runs: Array
    bounds: tuple[float, float]

    def estimates(self) -> list[Estimate]:
        """Each block's mean of shares over worlds, or motions or seconds of the median world."""
        return mean_shares(self.runs) if self.bounds == SHARE else medians(self.runs)


def edges_of(scenario: ScenarioConfig, ends: Sequence[int]) -> Array:
    """Where blocks of trials begin and end: `ends` after the beginning and each `at: {trial: n}`."""
    trials, _ = scenario.length
    found = {trials}
    for start, stop in pairwise(sorted({0, trials, *event_trials(scenario)})):
        found |= {start, *(start + end for end in ends if start + end < stop)}
    return np.array(sorted(found), float)


def event_trials(scenario: ScenarioConfig) -> set[int]:
    """The trials before which the schedule perturbs the world, each once."""
    return {e["at"]["trial"] for e in scenario.perturbations if "trial" in e.get("at", {})}


def trial_costs(rows: pd.DataFrame, scenario: ScenarioConfig) -> pd.DataFrame:
    """The agents' own trials, of the rows of `with_cost`, in robot seconds per reach too.

    There is a column for each look time.
    """
    mine = rows[rows["phase"] == "train"].copy()
    for look in LOOKS:
        mine[seconds_at(look)] = seconds_per_reach(mine, scenario.env.max_episode_steps, look)
    return mine


def seconds_per_reach(rows: pd.DataFrame, cap: int, look: float) -> "pd.Series[float]":
    """Robot seconds of each trial, of the rows of `with_cost`.

    A trial without a rendezvous counts as going on to the cap at its own pace, but not as more than
    `slowest_seconds`.
    """
    longer = (cap / rows["motions"]).where(rows[RENDEZVOUS] == 0, 1.0)
    seconds: pd.Series[float] = longer * robot_seconds_at(look, rows[SECONDS], rows["motions"])
    return seconds.clip(upper=slowest_seconds(cap, look))


def slowest_seconds(cap: int, look: float) -> float:
    """Robot seconds of `cap` motions, and of the way home, each a full turn: the most that a reach counts."""
    return (cap + 1) * (look + 2 * np.pi / HINGE_SPEED)


def blocks(costs: pd.DataFrame, agent: str, measure: str, worlds: int, edges: Array, cap: int) -> Blocks:
    """A measure's means over blocks of an agent's trials.

    Args:
        costs: What `trial_costs` returned.
        agent: The agent's label.
        measure: SUCCESS, RENDEZVOUS, MOTIONS or one of `seconds_at`.
        worlds: How many runs there should be; those without any row failed, and are worst throughout: no
            success, `cap` motions, and the seconds of `cap` motions of a full turn.
        edges: What `edges_of` returned.
        cap: Motions after which a trial has failed.
    """
    shares = measure in (SUCCESS, RENDEZVOUS)
    slowest = {seconds_at(look): slowest_seconds(cap, look) for look in LOOKS}
    most = float(cap) if measure == MOTIONS else slowest.get(measure, 1.0)
    worst, bounds = (0.0, SHARE) if shares else (most, (1.0 if measure == MOTIONS else 0.0, most))
    mine = costs[costs["agent"] == agent]
    mine = mine.assign(block=np.searchsorted(edges, mine["trial"], side="right") - 1)
    found = mine.pivot_table(index="world", columns="block", values=measure, aggfunc="mean")
    runs = found.reindex(index=range(worlds), columns=range(len(edges) - 1))
    runs.loc[~runs.index.isin(found.index)] = worst
    return Blocks(edges, runs.to_numpy(dtype=float), bounds)
