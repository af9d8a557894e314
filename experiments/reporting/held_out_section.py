"""The held-out trials of a scenario in the report: one figure, and tables of who reaches how soon."""

from dataclasses import dataclass
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.config.in_words import again_and_again, knocks
from experiments.config.suite import AgentConfig, ScenarioConfig
from experiments.evaluation import THRESHOLDS_PX
from experiments.reporting.agents_in_words import ASIDE, in_words, lines_of
from experiments.reporting.distance import HOW_FAR, distance_rows, distance_tables
from experiments.reporting.figures import (
    STYLE,
    Line,
    LineEnd,
    draw_worlds,
    drawn_in_words,
    label_lines,
    marks,
    motions_axis,
    save,
    say,
)
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    FinishedSuite,
    about,
    few_worlds,
    where_it_stands,
)
from experiments.reporting.head import head_part
from experiments.reporting.held_out import (
    AT_THE_END,
    GOOD,
    STRETCHES,
    HeldOut,
    common_worlds,
    differences,
    scores,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import MOST_COLUMNS, NOTHING, Table, number, percent, with_most, written
from experiments.statistics import Array, median_world, most_worlds, performance_profile

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


def held_out_sections(finished: FinishedSuite, held: HeldOut) -> list[Section]:
    """Learning curves and moments; checkpoints; motions to a threshold; errors at the end; a comparison."""
    sections = [_moments(finished, held)]
    if any(held.moments.values()):
        sections += [_checkpoints(finished, held), _threshold(finished, held), _profile(finished, held)]
    if len(held.moments) > 1:
        sections.append(comparison_section(finished, held))
    return sections


def _moments(finished: FinishedSuite, held: HeldOut) -> Section:
    """The curves, and all moments with and without their intervals."""
    scenario = held.scenario
    name, figures = f"{scenario.name}-held-out", {}
    if scenario != head_part(finished):  # that one has it above
        figures[name] = save(learning_picture(finished, held), finished.out / "figures", name)
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
                values = np.append(found, [float(held.cap)] * held.failed(label))
                if not len(values):
                    cells.append(NOTHING)
                    continue
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


# The one figure: motions per reach against motions lived, and those since a knock.

IMPROVING = 0.1
"""Share by which motions per reach fall, while the motions since the last knock double, of an agent that is
still improving at its end."""
_MOST_PANELS = 5
_HEIGHT, _WIDTH, _WIDE = 4.3, 7.6, 8.6  # inches; wide: with more than two panels
_LABELS, _LETTER = 2.7, 0.09  # inches, about: beside the panels, and of a letter above them


@dataclass(frozen=True, slots=True)
class _Stretch:
    """An agent between two knocks: motions lived (points,), motions per reach then (worlds, points)."""

    motions: Array
    worlds: Array

    @property
    def median(self) -> Array:
        """Of the worlds."""
        return np.median(self.worlds, axis=0)

    @property
    def improving(self) -> bool:
        """Whether the median world is better than it was after half as many motions."""
        earlier = np.interp(self.motions[-1] / 2, self.motions, self.median)
        return bool(self.median[-1] <= (1 - IMPROVING) * earlier)


def learning_picture(finished: FinishedSuite, held: HeldOut) -> Figure:
    """Motions per reach of the median world in held-out trials; each agent is named where its line ends.

    Left against the motions lived, up to the first knock; then a panel a knock, against motions since it.
    Where the world changes again and again, there is one panel. The axes are logarithmic, 0 is drawn at 1.
    """
    scenario, curves = held.scenario, _curves(held)
    lines = lines_of(finished.suite.agents)
    lived = ((stretch, each) for of_agent in curves.values() for stretch, each in of_agent.items())
    stretches = sorted({stretch for stretch, each in lived if each.motions[-1] > 0})
    with plt.rc_context(STYLE):
        width = _WIDTH if len(stretches) <= 2 else _WIDE
        letters = int((width - _LABELS) / len(stretches) / _LETTER)
        figure, panels = plt.subplots(
            1, len(stretches), figsize=(width, _HEIGHT), sharey=True, squeeze=False, layout="constrained"
        )
        motions_axis(panels[0, 0], held.cap)
        titles = _alike_high([fill(_title(scenario, stretch), letters) for stretch in stretches])
        for axes, stretch, title in zip(panels[0], stretches, titles, strict=True):
            for label, of_agent in curves.items():
                if stretch in of_agent:
                    motions, worlds = of_agent[stretch].motions, of_agent[stretch].worlds
                    draw_worlds(axes, np.maximum(motions, 1), worlds, lines[label], len(curves))
            longest = max(of[stretch].motions[-1] for of in curves.values() if stretch in of)
            _scale(axes, longest, "motions since" if stretch else "motions lived")
            axes.set_title(title, weight="bold", size=10)
        say(figure, f"Motions per reach (a failure counts as {held.cap})", _said(finished, scenario, curves))
        ends = [
            _end(agent, curves[agent.label], stretches[-1], longest, lines[agent.label])
            for agent in finished.suite.agents_in(scenario)
        ]
        label_lines(panels[0, -1], ends, 10)
    return figure


_Curves = dict[str, dict[int, _Stretch]]


def _curves(held: HeldOut) -> _Curves:
    """By an agent's label and the number of knocks before it."""
    rows, cap = held.rows, float(held.cap)
    if _in_one_panel(held.scenario):
        rows = rows.assign(stretch=0, clock=rows["lifetime_motions"])
    curves: _Curves = {}
    for label in held.worlds:
        own, failed = rows[rows["agent"] == label], held.failed(label)
        curves[label] = {
            int(stretch): _stretch(of_stretch, failed, cap) for stretch, of_stretch in own.groupby("stretch")
        }
        if own.empty:
            whole = np.array([0.0, held.scenario.most_motions])
            curves[label] = {0: _Stretch(whole, np.full((failed, 2), cap))}
    return curves


def _stretch(own: pd.DataFrame, failed: int, cap: float) -> _Stretch:
    """Where a world has no checkpoint of its own, its last one holds; failed runs count as the cap."""
    table = own.pivot_table(index="world", columns="clock", values=MOTIONS, aggfunc="mean")
    finished = table.ffill(axis=1).bfill(axis=1).to_numpy(float)
    worlds = np.pad(finished, ((0, failed), (0, 0)), constant_values=cap)
    return _Stretch(table.columns.to_numpy(float), worlds)


_MOST_MARKS = 3
"""So many powers of ten beside 1 are told apart in a narrow panel."""


def _in_one_panel(scenario: ScenarioConfig) -> bool:
    known = knocks(scenario)
    return known is None or len(known) >= _MOST_PANELS


def _scale(axes: Axes, longest: float, what: str) -> None:
    """From 1 to the longest, with a mark at each power of ten, or at each second one of many."""
    axes.set_xscale("log")
    axes.set_xlim(0.9, 1.1 * max(longest, 2))
    powers = int(np.log10(max(longest, 2)))
    marks(axes.xaxis, [10.0**power for power in range(0, powers + 1, 1 if powers <= _MOST_MARKS else 2)])
    axes.xaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}k" if x >= 1000 else f"{x:g}")
    axes.set_xlabel(what)
    axes.tick_params(labelleft=True)


def _alike_high(titles: list[str]) -> list[str]:
    """Titles with as many lines: panels that are drawn one by one stay level."""
    lines = max(title.count("\n") for title in titles)
    return [title + "\n" * (lines - title.count("\n")) for title in titles]


def _title(scenario: ScenarioConfig, stretch: int) -> str:
    known = knocks(scenario)
    if known is None:
        return again_and_again(scenario)
    if not known:
        return ""
    if _in_one_panel(scenario):
        return f"{len(known)} changes of the world"
    words = known[min(stretch, len(known)) - 1].words if stretch else "from the beginning"
    return words.replace(" by ", " by\N{NO-BREAK SPACE}")


def _said(finished: FinishedSuite, scenario: ScenarioConfig, curves: _Curves) -> str:
    evaluation = finished.suite.evaluation_of(scenario)
    trials = f"{evaluation.trials} held-out trials" if evaluation else "Held-out trials"
    worlds = {len(each.worlds) for of_agent in curves.values() for each in of_agent.values()}
    drawn = drawn_in_words(min(worlds), len(curves))
    return f"{where_it_stands(scenario, f'{trials} at each checkpoint', worlds)} {drawn}"


def _end(agent: AgentConfig, curves: dict[int, _Stretch], last: int, longest: float, line: Line) -> LineEnd:
    end = curves[max(curves)]
    words = in_words(agent.label, agent.name)
    if end.improving and agent.name not in ASIDE:
        words += ",\nstill improving"
    x = end.motions[-1] if last in curves else longest
    return LineEnd(max(x, 1), end.median[-1], words, line["color"])
