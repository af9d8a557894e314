"""What a scenario's held-out trials come to: made once, and handed to its tables, figures and sentences.

Runs that failed, without any row, count as worst; runs that finished count as what they came to.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.config.suite import ScenarioConfig
from experiments.reporting.distance import Distances, distances
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    FinishedSuite,
    with_cost,
)
from experiments.statistics import (
    Array,
    Estimate,
    mean_share,
    median_time,
    median_world,
    paired_motions,
    paired_shares,
    share_of_worlds,
)

BEFORE, RIGHT_AFTER, AT_THE_END = "before", "right after", "at the end"
"""Of a life: the last checkpoint before the world first changes, the next one, and the last of all."""
GOOD = 0.95
"""Share of a checkpoint's trials with an observed rendezvous."""
BEGINNING, AFTER = STRETCHES = ("from the beginning", "after the first change")
_LONGER_THAN_A_LIFE = 2.0**40  # motions


@dataclass(frozen=True, slots=True)
class HeldOutMoment:
    """An agent at one checkpoint of each of its runs.

    Attributes:
        worlds: One row a world: the means over its held-out trials of SUCCESS, RENDEZVOUS and MOTIONS, and of
            `among_reached`, the motions of trials with a rendezvous (NaN without any). A failed run is worst
            in all but that.
        motions: Per reach, of the median world; a trial without a rendezvous counts as the cap.
        among_reached: Motions of trials with a rendezvous, in the median of the worlds that have any.
        errors_px: True errors at the end of the trials (worlds, trials); infinite in failed runs.
        distances: At the end of a trial, of finished runs only.
    """

    finished: int
    worlds: pd.DataFrame
    success: Estimate
    rendezvous: Estimate
    motions: Estimate
    among_reached: Estimate
    errors_px: Array
    distances: Distances


class Times(NamedTuple):
    """After how many motions each world's run was good.

    Attributes:
        at: When it was first good, or was last looked at (worlds,).
        good: Whether it was (worlds,).
        latest: The latest time that was looked at.
        median: Of the worlds.
    """

    at: Array
    good: NDArray[np.bool_]
    latest: float
    median: Estimate


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The held-out trials of a scenario.

    Attributes:
        worlds: By an agent's label, in the suite's order, how many runs there should be.
    """

    scenario: ScenarioConfig
    rows: pd.DataFrame
    worlds: dict[str, int]
    moments: dict[str, dict[str, HeldOutMoment]]
    times: dict[str, dict[str, Times]]

    @property
    def cap(self) -> int:
        """Motions after which a trial has failed."""
        return self.scenario.env.max_episode_steps

    def failed(self, agent: str) -> int:
        """How many runs of an agent there should be and are not."""
        return self.worlds[agent] - self.rows.loc[self.rows["agent"] == agent, "world"].nunique()


def held_out(finished: FinishedSuite, scenario: ScenarioConfig) -> HeldOut:
    """What the held-out trials of a scenario come to."""
    rows = with_clocks(with_cost(finished.results, scenario))
    worlds = finished.worlds_in(scenario)
    of_agents = {agent: (rows[rows["agent"] == agent], amount) for agent, amount in worlds.items()}
    return HeldOut(
        scenario,
        rows,
        worlds,
        {agent: moments(*own, scenario.env.max_episode_steps) for agent, own in of_agents.items()},
        {agent: times_to_good(*own) for agent, own in of_agents.items()},
    )


def with_clocks(rows: pd.DataFrame) -> pd.DataFrame:
    """Of the rows of `with_cost` the held-out trials, each with the `stretch` and `clock` of its checkpoint.

    The stretch is how many times the world had changed before it, and the clock counts motions since the last
    time, or since the beginning. The agents' own trials tell of changes, too, after which nothing was held
    out.
    """
    since = pd.Series(
        rows["motions_since_perturbation"].astype("Float64").to_numpy(float, na_value=np.nan), rows.index
    )
    changed_at = rows["lifetime_motions"] - since
    stretch = changed_at.groupby([rows["agent"], rows["world"]]).rank("dense").fillna(0).astype(int)
    clocked = rows.assign(stretch=stretch, clock=since.fillna(rows["lifetime_motions"]))
    return clocked[clocked["phase"] == "eval"]


def moments(mine: pd.DataFrame, worlds: int, cap: int) -> dict[str, HeldOutMoment]:
    """An agent before and right after the first change of its world, and at the end; what there is, in order.

    Each run has its own; one whose world never changed has only an end. Of so many worlds those without any
    row failed: they are worst at every moment, except in distance.
    """
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


def _moment(rows: pd.DataFrame, failed: list[int], cap: int) -> HeldOutMoment:
    """The moment of these trials."""
    reached = rows[rows[RENDEZVOUS] == 1]
    own = rows.groupby("world")[[SUCCESS, RENDEZVOUS, MOTIONS]].mean()
    own["among_reached"] = reached.groupby("world")["motions"].mean()
    worst = {SUCCESS: 0.0, RENDEZVOUS: 0.0, MOTIONS: float(cap), "among_reached": np.nan}
    errors = [each.to_numpy(dtype=float) for _, each in rows.groupby("world")["error_px"]]
    trials = max(map(len, errors))
    infinite = [np.full(trials, np.inf)] * len(failed)
    worlds = pd.concat([own, pd.DataFrame(worst, index=failed)]).sort_index()
    return HeldOutMoment(
        finished=rows["world"].nunique(),
        worlds=worlds,
        success=mean_share(worlds[SUCCESS].to_numpy()),
        rendezvous=mean_share(worlds[RENDEZVOUS].to_numpy()),
        motions=median_world(worlds[MOTIONS].to_numpy()),
        among_reached=median_world(worlds["among_reached"].to_numpy(float)),
        errors_px=np.array([np.resize(each, trials) for each in errors] + infinite),
        distances=distances(rows),
    )


def times_to_good(mine: pd.DataFrame, worlds: int) -> dict[str, Times]:
    """When each world's run was first good, by the stretch of the lifetime; one that no run came to lacks.

    Of so many worlds those without any row were never good.
    """
    failed = worlds - mine["world"].nunique()
    return {
        name: _first_good(of_stretch, failed)
        for stretch, name in enumerate(STRETCHES)
        if len(of_stretch := mine[mine["stretch"] == stretch])
    }


def _first_good(rows: pd.DataFrame, failed: int) -> Times:
    shares = rows.groupby(["world", "clock"])[RENDEZVOUS].mean().reset_index()
    backwards = shares.sort_values("clock", ascending=False)
    shares["later"] = backwards.groupby("world")[RENDEZVOUS].transform(lambda own: own.expanding().mean())
    lasting = shares[(shares[RENDEZVOUS] >= GOOD) & (shares["later"] >= GOOD)]
    good = lasting.groupby("world")["clock"].min()
    last = shares.groupby("world")["clock"].max()
    latest = float(last.max())
    at = np.append(good.reindex(last.index).fillna(last).to_numpy(dtype=float), [latest] * failed)
    was_good = np.append(last.index.isin(good.index), [False] * failed)
    return Times(at, was_good, latest, median_time(at, was_good))


def scores(own: pd.DataFrame, measure: str, clock: float) -> "pd.Series[float]":
    """Each world's mean at a checkpoint of a stretch, or at its next; worlds that have neither lack."""
    found = own.groupby(["world", "clock"])[measure].mean().reset_index()
    return found[found["clock"] >= clock].groupby("world")[measure].first()


def differences(mine: HeldOutMoment, reference: HeldOutMoment) -> dict[str, Estimate]:
    """What an agent has more of than a reference, world by world, by the name of the measure.

    Only worlds in which both came to their moments are compared.
    """
    both = common_worlds(mine, reference)
    own, other = mine.worlds.loc[both], reference.worlds.loc[both]
    motions, others_motions = own[MOTIONS].to_numpy(), other[MOTIONS].to_numpy()
    return {
        RENDEZVOUS: paired_shares(own[RENDEZVOUS].to_numpy(), other[RENDEZVOUS].to_numpy()),
        MOTIONS: paired_motions(motions, others_motions),
        "fewer_motions": share_of_worlds(motions, others_motions),
    }


def common_worlds(mine: HeldOutMoment, reference: HeldOutMoment) -> "pd.Index[int]":
    """The worlds in which both came to their moments."""
    return mine.worlds.index.intersection(reference.worlds.index)
