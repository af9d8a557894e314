"""What a scenario's held-out trials come to, made once and handed on; and their part of the report.

Runs that failed, without any row, count as worst; runs that finished count as what they came to.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.config.suite import ScenarioConfig
from experiments.evaluation import THRESHOLDS_PX
from experiments.reporting.finished_suite import (
    HOW_FAR,
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    Distances,
    FinishedSuite,
    about,
    distance_rows,
    distance_tables,
    distances,
    few_worlds,
    with_cost,
)
from experiments.reporting.pages import Drawing, Section, summary_row
from experiments.reporting.tables import MOST_COLUMNS, NOTHING, Table, number, percent, with_most, written
from experiments.statistics import (
    Array,
    Estimate,
    mean_share,
    median_time,
    median_world,
    most_worlds,
    paired_motions,
    paired_shares,
    performance_profile,
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
        latest: The latest time that was looked at.
    """

    at: Array
    good: NDArray[np.bool_]
    latest: float
    median: Estimate


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The held-out trials of a scenario, and how many runs each label has, in the suite's order."""

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
    if not scenario.is_knocked:
        rows = rows.assign(stretch=0, clock=rows["lifetime_motions"])
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
    time, or since the beginning; what a life began with is no change. The agents' own trials tell of changes,
    too, after which nothing was held out.
    """
    since = pd.Series(
        rows["motions_since_perturbation"].astype("Float64").to_numpy(float, na_value=np.nan), rows.index
    )
    changed_at = (rows["lifetime_motions"] - since).fillna(-1)
    stretch = changed_at.groupby([rows["agent"], rows["world"]]).rank("dense").astype(int) - 1
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


_CHANGES = 3
"""Changes after which checkpoints are shown: a report has an end."""
_MOMENTS = (
    "Before: the last held-out trials before the world first changes. Right after: the first ones in the "
    "changed world. Motions per reach: the median world, a trial without a rendezvous counting as the cap; "
    "in brackets the 10th to the 90th percentile of worlds (of fewer than 20 the lowest and the highest). "
    "Rendezvous, the share of trials that end with an observed one, and motions of those trials alone are "
    "two numbers: each has its 95 % interval over worlds, of the mean and of the median. "
    f"{SUCCESS_IN_WORDS} A run that did not finish counts as no success and as the cap."
)
_CHECKPOINTS = (
    "Motions per reach in held-out trials, a trial without a rendezvous counting as the cap: the median "
    "world, and in brackets the 10th to the 90th percentile of worlds (of fewer than 20 the lowest and "
    "the highest). Where an agent has no checkpoint after exactly so many motions, its next one."
)
_GOOD = written(GOOD, ".0%")
_THRESHOLD = (
    f"Motions lived until the first checkpoint at which {_GOOD} of the held-out trials end with an "
    "observed rendezvous, as they do on average from there to the next change or the end (a lucky "
    "checkpoint does not count). Times are those of checkpoints: no finer than their distance. Median: "
    "over worlds, by Kaplan and Meier, since a life may end before; ∞ where half of the worlds do not "
    "come to it. Brackets: 95 % intervals."
)
_PROFILE = (
    "The share of held-out trials at the end of the lifetimes whose true error, the larger of both "
    "images', ended within so many pixels of 512: mean over worlds, with its 95 % interval over "
    "worlds. Errors count whether a rendezvous was observed or not. A run that did not finish has "
    "none within."
)
_COMPARISON = (
    "What an agent has more of than the first one, in the worlds in which both are, each at that moment "
    "of its own life. Rendezvous: the mean over worlds, in points of a percentage. Motions per reach (a "
    "failure counts as the cap): the median over worlds of the difference. Fewer motions: the share of "
    "worlds in which it needs fewer, equal ones counting half. Brackets: 95 % intervals over worlds."
)


def held_out_sections(finished: FinishedSuite, held: HeldOut, figures: dict[str, Drawing]) -> list[Section]:
    """Learning curves and moments; checkpoints; motions to a threshold; errors at the end; a comparison."""
    sections = [_moments(finished, held, figures)]
    if any(held.moments.values()):
        sections += [_checkpoints(finished, held), _threshold(finished, held), _profile(finished, held)]
    if len(held.moments) > 1:
        sections.append(comparison_section(finished, held))
    return sections


def _moments(finished: FinishedSuite, held: HeldOut, figures: dict[str, Drawing]) -> Section:
    """The curves, and all moments with and without their intervals."""
    scenario = held.scenario
    shown, intervals, summary = [], [], []
    for label, of_agent in held.moments.items():
        if not of_agent:
            shown.append([label, "no run finished", f"0 of {held.worlds[label]}", NOTHING, NOTHING])
        for when, moment in of_agent.items():
            success, rendezvous = moment.success, moment.rendezvous
            motions, reached = moment.motions, moment.among_reached
            spread = with_most(motions.value, most_worlds(moment.worlds[MOTIONS].to_numpy()), ".1f")
            worlds = f"{moment.finished} of {held.worlds[label]}"
            shown.append([label, when, worlds, spread, written(rendezvous.value, ".0%")])
            intervals.append([label, when, percent(rendezvous), number(reached), percent(success)])
            where, amount = (scenario.name, "held_out", label, when), len(moment.worlds)
            with_any = int(moment.worlds["among_reached"].notna().sum())
            summary += [
                summary_row(*where, SUCCESS, success, amount),
                summary_row(*where, RENDEZVOUS, rendezvous, amount),
                summary_row(*where, MOTIONS, motions, amount),
                summary_row(*where, f"{MOTIONS}_among_reached", reached, with_any),
                *distance_rows(*where, moment.distances),
            ]
    columns = ["agent", "when", "worlds", "motions per reach", "rendezvous"]
    with_intervals = ["agent", "when", "rendezvous", "motions of those that reached", "success"]
    title = f"{scenario.name}, with intervals"
    far = (
        ([label, when], moment.distances)
        for label, of_agent in held.moments.items()
        for when, moment in of_agent.items()
    )
    how_far = distance_tables(scenario.name, scenario.env, ["agent", "when"], far)
    return Section(
        title=f"{scenario.name}: held-out trials",
        text=about(finished, scenario),
        figures=figures,
        tables=(
            Table.of(f"{scenario.name}-moments", scenario.name, columns, shown),
            Table.of(f"{scenario.name}-intervals", title, with_intervals, intervals),
            *how_far,
        ),
        note=_MOMENTS + HOW_FAR * len(how_far),
        summary=summary,
    )


def _checkpoints(finished: FinishedSuite, held: HeldOut) -> Section:
    """Motions per reach of all agents, in a table from the beginning and one after each change."""
    name = held.scenario.name
    tables, summary = [], []
    for stretch, of_stretch in held.rows[held.rows["stretch"] <= _CHANGES].groupby("stretch"):
        after = f"after change {stretch}" if stretch else "from the beginning"
        clocks = shown_clocks(of_stretch["clock"].to_numpy(float))
        lines = []
        for label in held.worlds:
            own, cells = of_stretch[of_stretch["agent"] == label], [label]
            for clock in clocks:
                found = scores(own, MOTIONS, clock).to_numpy(float)
                if not len(found):
                    cells.append(NOTHING)
                    continue
                values = np.append(found, [float(held.cap)] * held.failed(label))
                median, when = median_world(values), f"{clock:,.0f} {after}"
                cells.append(with_most(median.value, most_worlds(values), ".1f"))
                summary.append(summary_row(name, "checkpoints", label, when, MOTIONS, median, len(values)))
            lines.append(cells)
        columns = ["agent", *(f"{'+' if stretch else ''}{clock:,.0f} motions" for clock in clocks)]
        tables.append(Table.of(f"{name}-checkpoints", f"{name}, motions per reach {after}", columns, lines))
    return Section(
        title=f"{name}: after how many motions",
        text=f"How fast each agent learns, and recovers.{few_worlds(finished, held.scenario)}",
        tables=tuple(tables),
        note=_CHECKPOINTS,
        summary=summary,
    )


def shown_clocks(clocks: Array) -> list[float]:
    """Checkpoints that a table has room for, of all: the first, the last, and between them by ratios."""
    found = np.unique(clocks)
    wanted = np.geomspace(max(found[0], 1), max(found[-1], 1), MOST_COLUMNS - 1)
    wanted[0] = found[0]
    nearest = [found[np.abs(np.log(found + 1) - np.log(each + 1)).argmin()] for each in wanted]
    return list(dict.fromkeys(nearest))


def _threshold(finished: FinishedSuite, held: HeldOut) -> Section:
    """Motions to the threshold, from the beginning and after the first change."""
    name = held.scenario.name
    lines, summary = [], []
    for label, times in held.times.items():
        cells = [label]
        for stretch in STRETCHES:
            if stretch not in times:
                cells += [NOTHING, NOTHING]
                continue
            good, median = times[stretch].good, times[stretch].median
            cells += [f"{int(good.sum())} of {len(good)}", number(median, 0)]
            summary.append(summary_row(name, "threshold", label, stretch, "median", median, len(good)))
        lines.append(cells)
    columns = ["agent", *(f"{what}, {stretch}" for stretch in STRETCHES for what in ("worlds", "median"))]
    title = f"{name}, motions lived until {_GOOD} rendezvous"
    return Section(
        title=f"{name}: motions lived until {_GOOD} rendezvous",
        text=f"How soon each agent is good.{few_worlds(finished, held.scenario)}",
        tables=(Table.of(f"{name}-threshold", title, columns, lines),),
        note=_THRESHOLD,
        summary=summary,
    )


def _profile(finished: FinishedSuite, held: HeldOut) -> Section:
    """Performance profiles: the share of trials that end within so many pixels of the object."""
    name = held.scenario.name
    lines, summary = [], []
    for agent, of_agent in held.moments.items():
        if AT_THE_END not in of_agent:
            continue
        errors = of_agent[AT_THE_END].errors_px
        profile = performance_profile(errors, THRESHOLDS_PX)
        lines.append([agent, *map(percent, profile)])
        summary += [
            summary_row(name, "profile", agent, f"{px} px", "within", share, len(errors))
            for px, share in zip(THRESHOLDS_PX, profile, strict=True)
        ]
    columns = ["agent", *(f"within {px} px" for px in THRESHOLDS_PX)]
    return Section(
        title=f"{name}: errors at the end",
        text=f"Performance profiles.{few_worlds(finished, held.scenario)}",
        tables=(Table.of(f"{name}-profile", f"{name}, errors at the end", columns, lines),),
        note=_PROFILE,
        summary=summary,
    )


def comparison_section(finished: FinishedSuite, held: HeldOut) -> Section:
    """Each agent beside the first one of the suite, at each moment to which both came in the same worlds."""
    name, (first, *others) = held.scenario.name, held.moments
    lines, summary = [], []
    for agent in others:
        for when, mine in held.moments[agent].items():
            reference = held.moments[first].get(when)
            if reference is None or not (both := len(common_worlds(mine, reference))):
                continue
            of = differences(mine, reference)
            shown = [percent(of[RENDEZVOUS]), number(of[MOTIONS]), percent(of["fewer_motions"])]
            lines.append([agent, when, *shown])
            where = name, "comparison", agent, when
            summary += [summary_row(*where, measure, each, both) for measure, each in of.items()]
    columns = ["agent", "when", "rendezvous", "motions per reach", "fewer motions"]
    return Section(
        title=f"{name}: beside {first}",
        text=f"Differences from {first} in the same worlds.{few_worlds(finished, held.scenario)}",
        tables=(Table.of(f"{name}-comparison", f"{name}, beside {first}", columns, lines),),
        note=_COMPARISON,
        summary=summary,
    )
