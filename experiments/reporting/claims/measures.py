"""From results.parquet to the number that a criterion is about, with its interval over worlds."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.config.claims import EXTREMES, Number, TrialsOf
from experiments.config.suite import ScenarioConfig, Suite, SweepConfig
from experiments.reporting.by_trial.estimates import seconds_per_reach
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, with_cost, worlds_of
from experiments.reporting.held_out.clocks import with_clocks
from experiments.statistics import (
    Estimate,
    mean_share,
    median_world,
    paired_motions,
    paired_shares,
    relative_change,
)

FIRST_MOTION_PX, EXPECTED_PX = 4, 16
"""Columns of `motions_to_...`: where a first motion counts as a reach, and what an expectation is about."""
NEAR_PX = 16
"""The true error of a trial that ended near."""
FEW_MOTIONS = 2
"""Held-out trials of so many motions are those that are asked to be kept. Choice: a remembered place and one
correction."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The number of a criterion.

    Attributes:
        estimate: With its 95 % interval over worlds.
        worlds: How many of them it is of.
    """

    estimate: Estimate
    worlds: int


def measured(results: pd.DataFrame, suite: Suite, criterion: Number) -> Measured | None:
    """What a criterion's number is; None where a run that it is about has not finished.

    It is the mean over worlds of shares and of their differences, and the median over worlds of motions and
    seconds, and of their differences in the same worlds. A world without such trials, as
    where a lifetime was over before, is left out; None where none is left.
    """
    part = _part(suite, criterion.of)
    rows = [_rows(results, _part(suite, trials), trials) for trials in criterion.trials()]
    for of_agent, trials in zip(rows, criterion.trials(), strict=True):
        if of_agent["world"].nunique() < worlds_of(suite, trials.agent):
            return None
    chosen = [_chosen(*each) for each in zip(rows, criterion.trials(), strict=True)]
    if criterion.measure == "kept":
        return _estimate(_kept(*chosen), criterion)
    if criterion.measure == "most_motions":
        return _most(chosen[0])
    values = [_by_world(trials, part, criterion) for trials in chosen]
    if criterion.than is None:
        return _estimate(values[0], criterion)
    both = values[0].index.intersection(values[1].index)
    if both.empty:
        return None
    mine, others = (of_worlds[both].to_numpy() for of_worlds in values)
    if criterion.relative:
        return Measured(relative_change(others, mine), len(both))
    if is_share(criterion):
        return Measured(paired_shares(mine, others), len(both))
    return Measured(paired_motions(mine, others), len(both))


def is_share(criterion: Number) -> bool:
    """Whether its number is a share of trials, or a difference of such."""
    return criterion.measure not in ("motions", "seconds", *EXTREMES)


def _part(suite: Suite, trials: TrialsOf) -> ScenarioConfig | SweepConfig:
    return next(part for part in suite.parts if part.name == trials.scenario)


def _rows(results: pd.DataFrame, part: ScenarioConfig | SweepConfig, trials: TrialsOf) -> pd.DataFrame:
    """All rows of the agent in the scenario or sweep."""
    return with_cost(results[results["agent"] == trials.agent], part)


def _chosen(rows: pd.DataFrame, trials: TrialsOf) -> pd.DataFrame:
    """The rows of the trials."""
    if trials.trials is not None:
        first, last = trials.trials
        return rows[(rows["phase"] == "train") & rows["trial"].between(first - 1, last - 1)]
    if trials.value is not None:
        in_view = rows["in_view"].fillna(False).astype(bool)
        return rows[(rows["phase"] == "sweep") & in_view & (rows["value"] == trials.value)]
    held_out = with_clocks(rows)
    held_out = held_out[held_out["lifetime_motions"] >= (trials.motions or 0)]
    for clock in ("lifetime_motions", "stretch"):  # right before a change, where it comes just then
        held_out = held_out[held_out[clock] == held_out.groupby("world")[clock].transform("min")]
    return held_out


def _by_world(
    trials: pd.DataFrame, part: ScenarioConfig | SweepConfig, criterion: Number
) -> "pd.Series[float]":
    """The measure's mean over each world's trials."""
    values = _values(trials, part, criterion)
    return values.groupby(trials["world"]).mean().dropna()


def _values(
    trials: pd.DataFrame, part: ScenarioConfig | SweepConfig, criterion: Number
) -> "pd.Series[float]":
    """The measure in each trial; NaN where it has none."""
    if criterion.look is not None:
        return seconds_per_reach(trials, part.env.max_episode_steps, criterion.look)
    columns = {"success": SUCCESS, "rendezvous": RENDEZVOUS, "motions": MOTIONS, "worst_world": MOTIONS}
    if criterion.measure in columns:
        return trials[columns[criterion.measure]].astype(float)
    if criterion.measure == "near":
        return (trials["error_px"] <= NEAR_PX).astype(float)
    if criterion.measure == "first_motion":
        return (trials[f"motions_to_{FIRST_MOTION_PX}"] == 1).astype(float)
    expected, came = trials["expected_px"] <= EXPECTED_PX, trials[f"motions_to_{EXPECTED_PX}"] == 1
    return (expected == came).astype(float).where(trials["expected_px"].notna())


def _kept(now: pd.DataFrame, then: pd.DataFrame) -> "pd.Series[float]":
    """Of each world's trials that took few motions then, the share that does now."""
    few = {
        name: trials.set_index(["world", "trial"])[MOTIONS] <= FEW_MOTIONS
        for name, trials in (("now", now), ("then", then))
    }
    both = pd.DataFrame(few).dropna().astype(bool)
    return both.loc[both["then"], "now"].groupby("world").mean().astype(float)


def _most(trials: pd.DataFrame) -> Measured | None:
    """Motions that 95 % of the trials need no more of."""
    if trials.empty:
        return None
    most = np.quantile(trials[MOTIONS], 0.95, method="averaged_inverted_cdf")
    return Measured(Estimate(float(most)), trials["world"].nunique())


def _estimate(values: "pd.Series[float]", criterion: Number) -> Measured | None:
    if values.empty:
        return None
    found = values.to_numpy()
    if criterion.measure == "worst_world":
        return Measured(Estimate(float(found.max())), len(found))
    return Measured(mean_share(found) if is_share(criterion) else median_world(found), len(found))
