"""From results.parquet to the tables of the report.

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
    """The median over worlds of each world's median over its own last checkpoints."""
    worst, bounds = worst_and_bounds(measure, scenario)
    mine = rows[rows["agent"] == agent]
    held_out = mine[mine["phase"] == "eval"].groupby(["world", "lifetime_motions"])[measure].mean()
    last = held_out.groupby("world").tail(LAST).groupby("world").median()
    values = np.append(last.to_numpy(float), [worst] * (worlds - mine["world"].nunique()))
    return over_worlds(values, median, bounds, np.random.default_rng(0))
