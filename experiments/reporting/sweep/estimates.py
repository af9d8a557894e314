"""From results.parquet to the points of a sweep's curves."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.config.suite import SweepConfig
from experiments.reporting.statistics import Array, Estimate, bootstrap_band, wilson_interval

_ENOUGH = 0.1
"""Share of the trials that must reach, for their median to mean anything."""


@dataclass(frozen=True, slots=True)
class Point:
    """An agent at one value of a sweep, over the trials in view.

    Attributes:
        value: Of what is varied.
        worlds: In each of which one trial is made.
        trials: Those in view; the same for every agent.
        success: Share of them that reach, with the 95 % Wilson interval; None where none is in view.
        at_once: Share of them that reach by their first motion.
        motions: Median of those that reach, with a 95 % bootstrap over worlds; None where hardly any does.
    """

    value: float
    worlds: int
    trials: int
    success: Estimate | None
    at_once: float
    motions: Estimate | None


def points(results: pd.DataFrame, sweep: SweepConfig, agent: str, worlds: int) -> list[Point]:
    """The points of one agent's curves.

    Args:
        results: All rows.
        sweep: What they are about.
        agent: Its label. A run that failed, without any row, has reached nothing.
        worlds: How many trials there should be at a value.
    """
    rows = results[results["scenario"] == sweep.name]
    return [_point(rows[rows["value"] == value], value, agent, worlds) for value in sweep.over]


def _point(rows: pd.DataFrame, value: float, agent: str, worlds: int) -> Point:
    in_view = rows[rows["in_view"].astype(bool)]
    trials = in_view["world"].nunique() if len(rows) else worlds
    if not trials:
        return Point(value, worlds, 0, None, 0.0, None)
    reached = in_view[(in_view["agent"] == agent) & in_view["success"]]["motions"].to_numpy(dtype=float)
    success = Estimate(len(reached) / trials, *wilson_interval(len(reached), trials))
    at_once = float((reached <= 1).sum()) / trials
    enough = len(reached) and len(reached) >= _ENOUGH * trials
    return Point(value, worlds, trials, success, at_once, _median(reached) if enough else None)


def _median(motions: Array) -> Estimate:
    low, high = bootstrap_band(motions, lambda of: np.median(of, axis=0), np.random.default_rng(0))
    return Estimate(float(np.median(motions)), float(low), float(high))
