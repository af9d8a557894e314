"""From results.parquet to the number that a test of a claim is about, with its interval over worlds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.config.claims import Criterion, Moment
from experiments.config.suite import ScenarioConfig, Suite, SweepConfig
from experiments.reporting.by_trial.estimates import seconds_per_reach, slowest_seconds
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, with_cost
from experiments.statistics import (
    Estimate,
    mean_share,
    median,
    over_worlds,
    paired_difference,
    paired_shares,
    relative_change,
)

FIRST_MOTION_PX, EXPECTED_PX = 4, 16
"""Columns of `motions_to_...`: where a first motion counts as a reach, and what an expectation is about."""
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


def measured(results: pd.DataFrame, suite: Suite, criterion: Criterion) -> Measured | None:
    """What a test's number is; None where no world has such trials.

    It is the mean over worlds of shares and differences, and the median over worlds of motions and seconds:
    one unseen world of 60 motions would rule the interval of their mean. A world whose run failed, without
    any row, counts as worst. A world whose lifetime was over before such trials is left out.
    """
    of = _by_world(results, suite, criterion, criterion.of)
    if criterion.measure == "kept":
        return _estimate(criterion, suite, _kept(results, suite, criterion))
    if criterion.than is None:
        return _estimate(criterion, suite, of)
    than = _by_world(results, suite, criterion, criterion.than)
    both = of.index.intersection(than.index)
    if both.empty:
        return None
    mine, others = of[both].to_numpy(), than[both].to_numpy()
    if criterion.relative:
        return Measured(relative_change(others, mine), len(both))
    if _is_share(criterion):
        return Measured(paired_shares(mine, others, np.random.default_rng(0)), len(both))
    return Measured(paired_difference(mine, others), len(both))


def _is_share(criterion: Criterion) -> bool:
    return criterion.measure not in ("motions", "seconds")


def _estimate(criterion: Criterion, suite: Suite, values: "pd.Series[float]") -> Measured | None:
    if values.empty:
        return None
    found = values.to_numpy()
    if _is_share(criterion):
        return Measured(mean_share(found, np.random.default_rng(0)), len(found))
    bounds = (1.0 if criterion.measure == "motions" else 0.0, _worst(criterion, _part(suite, criterion.of)))
    return Measured(over_worlds(found, median, bounds, np.random.default_rng(0)), len(found))


def _worst(criterion: Criterion, part: ScenarioConfig | SweepConfig) -> float:
    """What a failed run counts as."""
    cap = part.env.max_episode_steps
    if criterion.look is not None:
        return slowest_seconds(cap, criterion.look)
    return float(cap) if criterion.measure == "motions" else 0.0


def _part(suite: Suite, moment: Moment) -> ScenarioConfig | SweepConfig:
    return next(part for part in suite.parts if part.name == moment.scenario)


def _by_world(
    results: pd.DataFrame, suite: Suite, criterion: Criterion, moment: Moment
) -> "pd.Series[float]":
    """The measure's mean over each world's trials of a moment."""
    part = _part(suite, moment)
    mine = _of_agent(results, part, moment)
    rows = _trials_of(mine, moment)
    found = _values(rows, part, criterion).groupby(rows["world"]).mean()
    failed = sorted(set(range(suite.worlds)) - set(mine["world"]))
    return pd.concat([found, pd.Series(_worst(criterion, part), index=failed, dtype=float)]).sort_index()


def _of_agent(results: pd.DataFrame, part: ScenarioConfig | SweepConfig, moment: Moment) -> pd.DataFrame:
    rows = with_cost(results, part)
    return rows[rows["agent"] == moment.agent]


def _trials_of(mine: pd.DataFrame, moment: Moment) -> pd.DataFrame:
    """The rows of a moment's trials."""
    if moment.trials is not None:
        first, last = moment.trials
        return mine[(mine["phase"] == "train") & mine["trial"].between(first - 1, last - 1)]
    if moment.value is not None:
        in_view = mine["in_view"].fillna(False).astype(bool)
        return mine[(mine["phase"] == "sweep") & in_view & (mine["value"] == moment.value)]
    held_out = mine[(mine["phase"] == "eval") & (mine["lifetime_motions"] >= (moment.motions or 0))]
    first_checkpoint = held_out.groupby("world")["lifetime_motions"].transform("min")
    return held_out[held_out["lifetime_motions"] == first_checkpoint]


def _values(
    rows: pd.DataFrame, part: ScenarioConfig | SweepConfig, criterion: Criterion
) -> "pd.Series[float]":
    """The measure in each trial."""
    if criterion.look is not None:
        return seconds_per_reach(rows, part.env.max_episode_steps, criterion.look)
    columns: Mapping[str, str] = {"success": SUCCESS, "rendezvous": RENDEZVOUS, "motions": MOTIONS}
    if criterion.measure in columns:
        return rows[columns[criterion.measure]].astype(float)
    if criterion.measure == "first_motion":
        return (rows[f"motions_to_{FIRST_MOTION_PX}"] == 1).astype(float)
    expected = (rows["expected_px"] <= EXPECTED_PX).fillna(False)
    return (expected == (rows[f"motions_to_{EXPECTED_PX}"] == 1)).astype(float)


def _kept(results: pd.DataFrame, suite: Suite, criterion: Criterion) -> "pd.Series[float]":
    """Of each world's trials that took few motions at one moment, the share that does at another."""
    assert criterion.than is not None
    few = {}
    for name, moment in (("now", criterion.of), ("then", criterion.than)):
        rows = _trials_of(_of_agent(results, _part(suite, moment), moment), moment)
        few[name] = rows.set_index(["world", "trial"])[MOTIONS] <= FEW_MOTIONS
    both = pd.DataFrame(few).dropna().astype(bool)
    known = both[both["then"]]
    return known["now"].groupby("world").mean().astype(float) if len(known) else pd.Series(dtype=float)
