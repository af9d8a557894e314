"""From results.parquet to the curves and the table of the report.

Runs that failed, without any row, count as worst; runs that finished count as what they came to.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS
from experiments.statistics import (
    SHARE,
    Array,
    Estimate,
    bands,
    interquartile_mean,
    mean,
    mean_share,
    median,
    over_worlds,
    worst_decile,
)

LAST = 5
"""Checkpoints at the end of a lifetime of which the median is taken: some agents jump between them."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One measure of one agent against lifetime motions, over its runs.

    Attributes:
        motions: Lifetime motions, shape (points,).
        runs: The measure in each run, shape (runs, points).
        bounds: The lowest and the highest value that a run can have.
    """

    motions: Array
    runs: Array
    bounds: tuple[float, float]

    def estimates(self) -> list[Estimate]:
        """At each point the mean of a share over worlds, or the interquartile mean of motions."""
        estimand = mean if self.bounds == SHARE else interquartile_mean
        return bands(self.runs, estimand, self.bounds, np.random.default_rng(0)) if self.runs.size else []


@dataclass(frozen=True, slots=True)
class Moment:
    """An agent at one checkpoint of each of its runs.

    Attributes:
        finished: Runs that came to it.
        lifetime_motions: The fewest and the most, over these runs.
        worlds: One row a world: the means over its held-out trials of SUCCESS, RENDEZVOUS and MOTIONS, and of
            `among_reached`, the motions of trials with a rendezvous (NaN without any). A failed run is worst
            in all but that.
        errors_px: True errors at the end of the trials (worlds, trials); infinite in failed runs.
        distance_mm: Median true distance at the end of a trial, of finished runs only.
        cap: Motions after which a trial has failed.
    """

    finished: int
    lifetime_motions: tuple[int, int]
    worlds: pd.DataFrame
    errors_px: Array
    distance_mm: float
    cap: int

    def share(self, measure: str) -> Estimate:
        """The mean over worlds of SUCCESS or RENDEZVOUS."""
        return mean_share(self.worlds[measure].to_numpy(), np.random.default_rng(0))

    def motions(self) -> dict[str, Estimate]:
        """Of motions per reach: the mean, the interquartile mean and the worst tenth of the worlds."""
        values, bounds = self.worlds[MOTIONS].to_numpy(), (1.0, float(self.cap))
        estimands = {MOTIONS: mean, "iqm": interquartile_mean, "worst_decile": worst_decile}
        return {
            f"{MOTIONS}_{name}" if name != MOTIONS else name: over_worlds(
                values, estimand, bounds, np.random.default_rng(0)
            )
            for name, estimand in estimands.items()
        }

    def among_reached(self) -> Estimate | None:
        """The mean over worlds of motions of trials with a rendezvous; None where there is none."""
        values = self.worlds["among_reached"].dropna().to_numpy()
        if not len(values):
            return None
        return over_worlds(values, mean, (1.0, float(self.cap)), np.random.default_rng(0))


def held_out_curve(
    rows: pd.DataFrame, agent: str, measure: str, worlds: int, scenario: ScenarioConfig
) -> Curve:
    """A measure at each checkpoint, averaged over its trials.

    Args:
        rows: What `with_cost` returned.
        agent: The agent's label.
        measure: SUCCESS, RENDEZVOUS or MOTIONS.
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
    worst, bounds = worst_and_bounds(measure, scenario)
    of_phase = mine[mine["phase"] == phase]
    if of_phase.empty:
        motions = np.array([0.0, scenario.most_motions] if mine.empty else [])
        return Curve(motions, np.full((worlds, len(motions)), worst), bounds)
    table = of_phase.pivot_table(index="world", columns=axis, values=measure, aggfunc="mean")
    finished = table.ffill(axis=1).bfill(axis=1).to_numpy(dtype=float)
    failed = np.full((worlds - mine["world"].nunique(), len(table.columns)), worst)
    return Curve(table.columns.to_numpy(dtype=float), np.vstack([finished, failed]), bounds)


def worst_and_bounds(measure: str, scenario: ScenarioConfig) -> tuple[float, tuple[float, float]]:
    """What a failed run counts as in a measure, and the lowest and the highest value that a run can have."""
    cap = float(scenario.env.max_episode_steps)
    return (cap, (1.0, cap)) if measure == MOTIONS else (0.0, SHARE)


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
    failed = sorted(set(range(worlds)) - set(mine["world"]))
    return {name: _moment(mine, at, failed, cap) for name, at in chosen.items() if len(at)}


def _moment(mine: pd.DataFrame, at: "pd.Series[int]", failed: list[int], cap: int) -> Moment:
    """The moment at which run w has made `at[w]` lifetime motions."""
    rows = mine[mine["lifetime_motions"] == mine["world"].map(at)]
    reached = rows[rows[RENDEZVOUS] == 1]
    own = rows.groupby("world")[[SUCCESS, RENDEZVOUS, MOTIONS]].mean()
    own["among_reached"] = reached.groupby("world")["motions"].mean()
    worst = {SUCCESS: 0.0, RENDEZVOUS: 0.0, MOTIONS: float(cap), "among_reached": np.nan}
    errors = [each.to_numpy(dtype=float) for _, each in rows.groupby("world")["error_px"]]
    trials = max(map(len, errors))
    return Moment(
        finished=len(at),
        lifetime_motions=(int(at.min()), int(at.max())),
        worlds=pd.concat([own, pd.DataFrame(worst, index=failed)]).sort_index(),
        errors_px=np.array(
            [np.resize(each, trials) for each in errors] + [np.full(trials, np.inf)] * len(failed)
        ),
        distance_mm=float(rows["distance_mm"].median()),
        cap=cap,
    )


def last_checkpoints(
    rows: pd.DataFrame, agent: str, measure: str, worlds: int, scenario: ScenarioConfig
) -> Estimate:
    """The median over worlds of each world's median over its own last checkpoints; see `held_out_curve`."""
    worst, bounds = worst_and_bounds(measure, scenario)
    mine = rows[rows["agent"] == agent]
    held_out = mine[mine["phase"] == "eval"].groupby(["world", "lifetime_motions"])[measure].mean()
    last = held_out.groupby("world").tail(LAST).groupby("world").median()
    values = np.append(last.to_numpy(float), [worst] * (worlds - mine["world"].nunique()))
    return over_worlds(values, median, bounds, np.random.default_rng(0))
