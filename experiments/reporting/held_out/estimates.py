"""From results.parquet to the curves and the table of the report.

Runs that failed, without any row, count as worst; runs that finished count as what they came to.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, SUCCESS
from experiments.reporting.statistics import (
    Array,
    Estimate,
    bootstrap_band,
    interquartile_mean,
    wilson_interval,
)


@dataclass(frozen=True, slots=True)
class Curve:
    """One measure of one agent against lifetime motions, over its runs.

    Attributes:
        motions: Lifetime motions, shape (points,).
        runs: The measure in each run, shape (runs, points).
    """

    motions: Array
    runs: Array

    @property
    def mean(self) -> Array:
        """Mean over the runs, shape (points,)."""
        return np.asarray(self.runs.mean(axis=0))

    def band(self) -> tuple[Array, Array]:
        """95 % bootstrap over whole runs, each edge of shape (points,)."""
        return bootstrap_band(self.runs, lambda runs: np.asarray(runs.mean(axis=0)), np.random.default_rng(0))


@dataclass(frozen=True, slots=True)
class Moment:
    """An agent at one checkpoint of each of its runs, and over their held-out trials.

    Attributes:
        worlds: Finished runs that came to it.
        lifetime_motions: The fewest and the most, over these runs.
        trials: Held-out trials of all runs; failed runs count as having made as many as the others.
        success: Share of these trials; all those of failed runs count as failed.
        motions_per_reach: Interquartile mean over runs; failed runs count as the cap.
        distance_mm: Median true distance at the end of a trial, of finished runs only.
    """

    worlds: int
    lifetime_motions: tuple[int, int]
    trials: int
    success: Estimate
    motions_per_reach: Estimate
    distance_mm: float


def held_out_curve(
    rows: pd.DataFrame, agent: str, measure: str, worlds: int, scenario: ScenarioConfig
) -> Curve:
    """A measure at each checkpoint, averaged over its trials.

    Args:
        rows: What `with_cost` returned.
        agent: The agent's label.
        measure: SUCCESS or MOTIONS.
        worlds: How many runs there should be; those without any row failed, and are worst throughout.
        scenario: What the rows are about.
    """
    return _curve(rows[rows["agent"] == agent], "eval", "lifetime_motions", measure, worlds, scenario)


def training_curve(
    rows: pd.DataFrame,
    agent: str,
    measure: str,
    worlds: int,
    scenario: ScenarioConfig,
    width: int,
) -> Curve:
    """A measure over the agent's own trials, averaged in stretches of `width` lifetime motions."""
    mine = rows[rows["agent"] == agent].copy()
    mine["stretch"] = ((mine["lifetime_motions"] - 1) // width + 0.5) * width
    return _curve(mine, "train", "stretch", measure, worlds, scenario)


def _curve(
    mine: pd.DataFrame, phase: str, axis: str, measure: str, worlds: int, scenario: ScenarioConfig
) -> Curve:
    """Runs brought onto one axis: where a run has no value of its own, its last one holds."""
    worst = 0.0 if measure == SUCCESS else float(scenario.env.max_episode_steps)
    of_phase = mine[mine["phase"] == phase]
    if of_phase.empty:
        motions = np.array([0.0, scenario.most_motions] if mine.empty else [])
        return Curve(motions, np.full((worlds, len(motions)), worst))
    table = of_phase.pivot_table(index="world", columns=axis, values=measure, aggfunc="mean")
    finished = table.ffill(axis=1).bfill(axis=1).to_numpy(dtype=float)
    failed = np.full((worlds - mine["world"].nunique(), len(table.columns)), worst)
    return Curve(table.columns.to_numpy(dtype=float), np.vstack([finished, failed]))


def moments(rows: pd.DataFrame, agent: str, worlds: int, cap: int) -> dict[str, Moment]:
    """An agent before its first perturbation, right after it, and at the end of its lifetime.

    Each run has its own moments; a run that finished unperturbed has only an end. Runs that failed
    are worst at every moment, except in distance.

    Args:
        rows: What `with_cost` returned.
        agent: The agent's label.
        worlds: How many runs there should be; those without any row failed.
        cap: Motions after which a trial has failed.
    """
    mine = rows[(rows["agent"] == agent) & (rows["phase"] == "eval")]
    perturbed = mine["motions_since_perturbation"].notna()
    first = mine[perturbed].groupby("world")["lifetime_motions"].min()
    last = mine[~perturbed].groupby("world")["lifetime_motions"].max()
    chosen = {
        "before": last[last.index.isin(first.index)],
        "right after": first,
        "at the end": mine.groupby("world")["lifetime_motions"].max(),
    }
    failed = worlds - mine["world"].nunique()
    return {name: _moment(mine, at, failed, cap) for name, at in chosen.items() if len(at)}


def _moment(mine: pd.DataFrame, at: Any, failed: int, cap: int) -> Moment:
    """The moment at which run w has made `at[w]` lifetime motions."""
    rows = mine[mine["lifetime_motions"] == mine["world"].map(at)]
    runs: Any = rows.groupby("world")
    trials = len(rows) + failed * int(runs.size().max())
    successes = int(rows["success"].sum())
    per_run = np.append(runs[MOTIONS].mean().to_numpy(), np.full(failed, float(cap)))
    low, high = bootstrap_band(per_run, interquartile_mean, np.random.default_rng(0))
    return Moment(
        worlds=len(at),
        lifetime_motions=(int(at.min()), int(at.max())),
        trials=trials,
        success=Estimate(successes / trials, *wilson_interval(successes, trials)),
        motions_per_reach=Estimate(float(interquartile_mean(per_run)), float(low), float(high)),
        distance_mm=float(rows["distance_mm"].median()),
    )
