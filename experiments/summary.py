"""From results.parquet to the curves and the table of the report; failed runs count as worst."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from experiments.config import ScenarioConfig
from experiments.statistics import Array, bootstrap_band, interquartile_mean, wilson_interval

SUCCESS, MOTIONS = "success", "motions_per_reach"


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
class Cell:
    """One number of the table, with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Moment:
    """An agent at one checkpoint: over its runs, and over their held-out trials."""

    lifetime_motions: int
    success: Cell
    motions_per_reach: Cell
    distance_mm: float


def with_cost(results: pd.DataFrame, scenario: ScenarioConfig) -> pd.DataFrame:
    """The rows of one scenario, with motions per reach: a failed trial counts as the cap."""
    rows = results[results["scenario"] == scenario.name].copy()
    cap = scenario.env.max_episode_steps
    rows[MOTIONS] = rows["motions"].where(rows["success"], cap).astype(float)
    rows[SUCCESS] = rows["success"].astype(float)
    return rows


def held_out_curve(
    rows: pd.DataFrame, agent: str, measure: str, worlds: int, scenario: ScenarioConfig
) -> Curve:
    """A measure at each examination, averaged over its trials.

    Args:
        rows: What `with_cost` returned.
        agent: The agent's label.
        measure: SUCCESS or MOTIONS.
        worlds: How many runs there should be; missing ones count as failure throughout.
        scenario: What the rows are about.
    """
    mine = rows[(rows["agent"] == agent) & (rows["phase"] == "eval")]
    return _curve(mine, "lifetime_motions", measure, worlds, scenario)


def training_curve(
    rows: pd.DataFrame,
    agent: str,
    measure: str,
    worlds: int,
    scenario: ScenarioConfig,
    width: int,
) -> Curve:
    """A measure over the agent's own trials, averaged in stretches of `width` lifetime motions."""
    mine = rows[(rows["agent"] == agent) & (rows["phase"] == "train")].copy()
    mine["stretch"] = ((mine["lifetime_motions"] - 1) // width + 0.5) * width
    return _curve(mine, "stretch", measure, worlds, scenario)


def _curve(rows: pd.DataFrame, axis: str, measure: str, worlds: int, scenario: ScenarioConfig) -> Curve:
    worst = 0.0 if measure == SUCCESS else float(scenario.env.max_episode_steps)
    if rows.empty:
        return Curve(np.array([0.0, scenario.motions]), np.full((worlds, 2), worst))
    table = rows.pivot_table(index="pair", columns=axis, values=measure, aggfunc="mean")
    table = table.reindex(range(worlds)).fillna(worst)
    return Curve(table.columns.to_numpy(dtype=float), table.to_numpy(dtype=float))


def moments(rows: pd.DataFrame, agent: str, worlds: int, cap: int) -> dict[str, Moment]:
    """An agent before its first perturbation, right after it, and at the end of its life."""
    mine = rows[(rows["agent"] == agent) & (rows["phase"] == "eval")]
    if mine.empty:
        return {}
    unperturbed = mine["motions_since_perturbation"].isna()
    chosen = {"at the end": mine["lifetime_motions"].max()}
    if not unperturbed.all():
        chosen = {
            "before": mine.loc[unperturbed, "lifetime_motions"].max(),
            "right after": mine.loc[~unperturbed, "lifetime_motions"].min(),
            **chosen,
        }
    return {
        name: _moment(mine[mine["lifetime_motions"] == at], int(at), worlds, cap)
        for name, at in chosen.items()
    }


def _moment(rows: pd.DataFrame, at: int, worlds: int, cap: int) -> Moment:
    runs: Any = rows.groupby("pair")
    trials = int(runs.size().max()) * worlds
    successes = int(rows["success"].sum())
    per_run = runs[MOTIONS].mean().reindex(range(worlds)).fillna(float(cap)).to_numpy()
    low, high = bootstrap_band(per_run, interquartile_mean, np.random.default_rng(0))
    return Moment(
        lifetime_motions=at,
        success=Cell(successes / trials, *wilson_interval(successes, trials)),
        motions_per_reach=Cell(float(interquartile_mean(per_run)), float(low), float(high)),
        distance_mm=float(rows["distance_mm"].median()),
    )
