"""From results.parquet to the points of a sweep's curves."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.config.suite import SweepConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, with_cost
from experiments.statistics import Estimate, mean_share, median_world

_ENOUGH = 0.1
"""Share of the trials that must reach, for their median to mean anything."""


@dataclass(frozen=True, slots=True)
class Point:
    """An agent at one value of a sweep, over the trials in view.

    Attributes:
        value: Of what is varied.
        worlds: In each of which one trial is made.
        trials: Those in view; the same for every agent. Where it is 0, all that follows is None.
        success: Share of them whose true error at the end is within the tolerance.
        rendezvous: Share of them that end with an observed rendezvous.
        at_once: Share of them that do so by their first motion.
        motions: Of the median world; a trial without a rendezvous counts as the cap.
        among_reached: Median of those with a rendezvous; None where hardly any has one.
    """

    value: float
    worlds: int
    trials: int
    success: Estimate | None = None
    rendezvous: Estimate | None = None
    at_once: float = 0.0
    motions: Estimate | None = None
    among_reached: Estimate | None = None


def points(results: pd.DataFrame, sweep: SweepConfig, agent: str, worlds: int) -> list[Point]:
    """The points of one agent's curves.

    Args:
        results: All rows.
        sweep: What they are about.
        agent: Its label. A run that failed, without any row, has reached nothing.
        worlds: How many trials there should be at a value.
    """
    rows = with_cost(results, sweep)
    cap = sweep.env.max_episode_steps
    return [_point(rows[rows["value"] == value], value, agent, worlds, cap) for value in sweep.over]


def _point(rows: pd.DataFrame, value: float, agent: str, worlds: int, cap: int) -> Point:
    in_view = rows[rows["in_view"].astype(bool)]
    trials = in_view["world"].nunique() if len(rows) else worlds
    if not trials:
        return Point(value, worlds, 0)
    mine = in_view[in_view["agent"] == agent]
    failed = trials - len(mine)
    reached = mine.loc[mine[RENDEZVOUS] == 1, "motions"].to_numpy(dtype=float)
    success, rendezvous, motions = (
        np.append(mine[measure].to_numpy(dtype=float), [worst] * failed)
        for measure, worst in ((SUCCESS, 0.0), (RENDEZVOUS, 0.0), (MOTIONS, float(cap)))
    )
    return Point(
        value,
        worlds,
        trials,
        mean_share(success),
        mean_share(rendezvous),
        float((reached <= 1).sum()) / trials,
        median_world(motions),
        median_world(reached) if len(reached) >= max(1, _ENOUGH * trials) else None,
    )
