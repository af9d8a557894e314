"""From results.parquet to the tables of the report.

Runs that failed, without any row, count as worst; runs that finished count as what they came to.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS
from experiments.reporting.held_out.clocks import with_clocks
from experiments.statistics import SHARE, Array, Estimate, mean_share, median_world


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
    """

    finished: int
    lifetime_motions: tuple[int, int]
    worlds: pd.DataFrame
    errors_px: Array
    distance_mm: float

    def share(self, measure: str) -> Estimate:
        """The mean over worlds of SUCCESS or RENDEZVOUS."""
        return mean_share(self.worlds[measure].to_numpy())

    def motions(self) -> Estimate:
        """Motions per reach of the median world, a trial without a rendezvous counting as the cap."""
        return median_world(self.worlds[MOTIONS].to_numpy())

    def among_reached(self) -> Estimate:
        """Motions of trials with a rendezvous, in the median of the worlds that have any."""
        return median_world(self.worlds["among_reached"].to_numpy(float))


def worst_and_bounds(measure: str, scenario: ScenarioConfig) -> tuple[float, tuple[float, float]]:
    """What a failed run counts as in a measure, and the lowest and the highest value that a run can have."""
    cap = float(scenario.env.max_episode_steps)
    return (cap, (1.0, cap)) if measure == MOTIONS else (0.0, SHARE)


BEFORE, RIGHT_AFTER, AT_THE_END = MOMENTS = ("before", "right after", "at the end")
"""Of a life: the last checkpoint before the world first changes, the next one, and the last of all."""


def moments(rows: pd.DataFrame, agent: str, worlds: int, cap: int) -> dict[str, Moment]:
    """An agent at `MOMENTS`.

    Each run has its own; one whose world never changed has only an end. Runs that failed are worst at every
    moment, except in distance.

    Args:
        rows: What `with_cost` returned.
        agent: The agent's label.
        worlds: How many runs there should be; those without any row failed.
        cap: Motions after which a trial has failed.
    """
    mine = with_clocks(rows[rows["agent"] == agent])
    failed = sorted(set(range(worlds)) - set(mine["world"]))
    first, changed = (mine["stretch"] == 0), mine[mine["stretch"] > 0]
    chosen = {
        BEFORE: _at(mine[first & mine["world"].isin(changed["world"])], "max"),
        RIGHT_AFTER: _at(changed, "min"),
        AT_THE_END: _at(mine, "max"),
    }
    return {name: _moment(own, failed, cap) for name, own in chosen.items() if len(own)}


def _at(mine: pd.DataFrame, which: str) -> pd.DataFrame:
    """The trials of each world's first or last checkpoint; one right before a change is not that after it."""
    when = mine["stretch"] * _LONGER_THAN_A_LIFE + mine["clock"]
    return mine[when == when.groupby(mine["world"]).transform(which)]


_LONGER_THAN_A_LIFE = 2.0**40  # motions


def _moment(rows: pd.DataFrame, failed: list[int], cap: int) -> Moment:
    """The moment of these trials."""
    reached = rows[rows[RENDEZVOUS] == 1]
    own = rows.groupby("world")[[SUCCESS, RENDEZVOUS, MOTIONS]].mean()
    own["among_reached"] = reached.groupby("world")["motions"].mean()
    worst = {SUCCESS: 0.0, RENDEZVOUS: 0.0, MOTIONS: float(cap), "among_reached": np.nan}
    errors = [each.to_numpy(dtype=float) for _, each in rows.groupby("world")["error_px"]]
    trials = max(map(len, errors))
    at = rows["lifetime_motions"]
    return Moment(
        finished=rows["world"].nunique(),
        lifetime_motions=(int(at.min()), int(at.max())),
        worlds=pd.concat([own, pd.DataFrame(worst, index=failed)]).sort_index(),
        errors_px=np.array(
            [np.resize(each, trials) for each in errors] + [np.full(trials, np.inf)] * len(failed)
        ),
        distance_mm=float(rows["distance_mm"].median()),
    )
