"""Sweeps: success and motions against one setting of a perturbation."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from calfree_gym.perturbations import TYPES
from experiments.config.in_words import axis_in_words
from experiments.config.suite import AgentConfig, SweepConfig
from experiments.reporting.figures import (
    STYLE,
    Line,
    LineEnd,
    in_words,
    label_lines,
    lines_of,
    marks,
    motions_axis,
    save,
    say,
)
from experiments.reporting.finished_suite import (
    HOW_FAR,
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    Distances,
    FinishedSuite,
    about_environment,
    distance_rows,
    distance_tables,
    distances,
    few_worlds,
    judged_alike,
    where_it_stands,
    with_cost,
)
from experiments.reporting.pages import Section, SummaryRow, summary_row
from experiments.reporting.tables import Table, counted, number, percent
from experiments.running.results_folder import FIGURES
from experiments.statistics import Estimate, mean_share, median_world

_NO_NUMBER = Estimate(math.nan)
_SHOWN = 5
"""Values that stand in the table; the figure has all."""
_ENOUGH = 0.1
"""Share of the trials that must reach, for their median to mean anything."""
_ACROSS = 3
"""Sweeps side by side."""
_LOST = 0.95
"""An agent without success in more than this share of all trials at every value has no line on the left."""
_NEEDED = "Motions per reach (a failure: {})"
_HOW_TO_READ = (
    "Of the trials in whose first observation both cameras see gripper and object, the same for every "
    "agent. Success: the share whose true error at the end is within the tolerance. Rendezvous: the share "
    "that ends with an observed one. Motions: the median of those with one, where at least a tenth has "
    "one. Brackets: 95 % intervals over worlds, one trial in each."
)


@dataclass(frozen=True, slots=True)
class Point:
    """An agent at one value of a sweep, over the trials in view.

    Attributes:
        trials: Those in view; the same for every agent. Where it is 0, no number follows.
        at_once: Share of them that do so by their first motion.
        among_reached: Median of those with a rendezvous; no number where hardly any has one.
        distances: At the end of the trials of a run that finished.
    """

    value: float
    trials: int
    success: Estimate = _NO_NUMBER
    rendezvous: Estimate = _NO_NUMBER
    at_once: float = 0.0
    motions: Estimate = _NO_NUMBER
    among_reached: Estimate = _NO_NUMBER
    distances: Distances | None = None


@dataclass(frozen=True, slots=True)
class Swept:
    """The trials of a sweep: how many a label should have at a value, and the points of its curve."""

    sweep: SweepConfig
    worlds: dict[str, int]
    points: dict[str, list[Point]]


def swept(finished: FinishedSuite, sweep: SweepConfig) -> Swept:
    """What a sweep comes to."""
    rows, worlds = with_cost(finished.results, sweep), finished.worlds_in(sweep)
    return Swept(sweep, worlds, {agent: points(rows, sweep, agent, worlds[agent]) for agent in worlds})


def points(rows: pd.DataFrame, sweep: SweepConfig, agent: str, worlds: int) -> list[Point]:
    """The points of one agent's curves, of the rows of `with_cost`; a failed run has reached nothing."""
    cap = sweep.env.max_episode_steps
    return [_point(rows[rows["value"] == value], value, agent, worlds, cap) for value in sweep.over]


def _point(rows: pd.DataFrame, value: float, agent: str, worlds: int, cap: int) -> Point:
    in_view = rows[rows["in_view"].astype(bool) & (rows["world"] < worlds)]
    trials = in_view["world"].nunique() if len(rows) else worlds
    if not trials:
        return Point(value, 0)
    mine = in_view[in_view["agent"] == agent]
    failed = trials - len(mine)
    reached = mine.loc[mine[RENDEZVOUS] == 1, "motions"].to_numpy(dtype=float)
    success, rendezvous, motions = (
        np.append(mine[measure].to_numpy(dtype=float), [worst] * failed)
        for measure, worst in ((SUCCESS, 0.0), (RENDEZVOUS, 0.0), (MOTIONS, float(cap)))
    )
    return Point(
        value,
        trials,
        mean_share(success),
        mean_share(rendezvous),
        float((reached <= 1).sum()) / trials,
        median_world(motions),
        median_world(reached) if len(reached) >= max(1, _ENOUGH * trials) else _NO_NUMBER,
        distances(mine) if len(mine) else None,
    )


Curves = Sequence[tuple[AgentConfig, list[Point], Line]]
"""Of each agent, with its line."""


def sweep_sections(finished: FinishedSuite, found: Sequence[Swept]) -> list[Section]:
    """Where there are several sweeps, all in one figure; then each with a figure and a table."""
    lines, folder = lines_of(finished.suite.agents), finished.out / FIGURES
    said = [where_it_stands(each.sweep, "One trial at each value", each.worlds.values()) for each in found]
    curves: dict[str, Curves] = {
        each.sweep.name: [
            (agent, each.points[agent.label], lines[agent.label])
            for agent in finished.suite.agents_in(each.sweep)
        ]
        for each in found
    }
    sections = []
    for each, words in zip(found, said, strict=True):
        name, shown = each.sweep.name, _shown(each)
        far = [([label, f"{at.value:g}"], at.distances) for label, at in shown if at.distances is not None]
        how_far = distance_tables(name, each.sweep.env, ["agent", each.sweep.vary], far)
        figure = save(sweep_figure(each.sweep, curves[name], words), folder, name)
        sections.append(
            Section(
                title=f"Sweep {name}",
                text=_about(finished, each.sweep),
                figures={name: figure},
                tables=(_table(each.sweep, shown), *how_far),
                note=_HOW_TO_READ + HOW_FAR * len(how_far),
                summary=[*_summary(each)],
            )
        )
    sweeps = [each.sweep for each in found]
    if len(sweeps) < 2 or not judged_alike(sweeps):
        return sections
    together = save(sweeps_figure(sweeps, curves, said[0]), folder, "_all")
    return [Section(title="All sweeps", figures={"_all": together}), *sections]


def _summary(found: Swept) -> Iterator[SummaryRow]:
    every = [(label, point) for label, curve in found.points.items() for point in curve]
    for label, point in every:
        where = found.sweep.name, "sweep", label, f"{point.value:g}"
        yield summary_row(*where, SUCCESS, point.success, point.trials)
        yield summary_row(*where, RENDEZVOUS, point.rendezvous, point.trials)
        yield summary_row(*where, "rendezvous_at_once", point.at_once, point.trials)
        yield summary_row(*where, MOTIONS, point.motions, point.trials)
        yield summary_row(*where, "median_motions", point.among_reached, point.trials)
    for label, point in every:
        if point.distances:
            yield from distance_rows(found.sweep.name, "sweep", label, f"{point.value:g}", point.distances)


_FARTHER = ", but that objects begin farther from the gripper where noise is larger"


def _about(finished: FinishedSuite, sweep: SweepConfig) -> str:
    do = sweep.do
    settings = [f"{key} {value}" for key, value in do.items() if key != "type"]
    settings += [f"any {key}" for key in TYPES[do["type"]].settings() if key not in (*do, sweep.vary)]
    settings.append(f"{sweep.vary} from {sweep.over[0]:g} to {sweep.over[-1]:g}")
    return (
        f"{do['type']} ({', '.join(settings)}) before the first trial; {about_environment(sweep.env)}, at "
        f"most {sweep.env.max_episode_steps} motions. At each value every agent, without learning, makes "
        f"one trial in each of {counted(finished.fewest_worlds(sweep), 'world')}, the same for all agents "
        f"and values{_FARTHER * (do['type'] == 'point_noise')}.{few_worlds(finished, sweep)}"
    )


def _shown(found: Swept) -> list[tuple[str, Point]]:
    """By label, the points that stand in tables."""
    indices = np.unique(np.linspace(0, len(found.sweep.over) - 1, _SHOWN).round().astype(int))
    return [(label, curve[i]) for label, curve in found.points.items() for i in indices]


def _table(sweep: SweepConfig, shown: Sequence[tuple[str, Point]]) -> Table:
    rows = [
        [label, f"{at.value:g}", percent(at.rendezvous), number(at.among_reached), percent(at.success)]
        for label, at in shown
    ]
    columns = ["agent", sweep.vary, "rendezvous", "motions of those that reached", "success"]
    return Table.of(sweep.name, f"Sweep {sweep.name}", columns, rows)


def sweep_figure(sweep: SweepConfig, curves: Curves, said: str) -> Figure:
    """Trials without success on the left, and motions per reach on the right, both against the value."""
    with plt.rc_context(STYLE):
        figure, (misses, motions) = plt.subplots(1, 2, figsize=(8.6, 4), layout="constrained")
        lost, worst = [], 0.0
        for agent, points, line in curves:
            shares = [1 - point.success.value for point in points]
            if all(share > _LOST for share in shares if not math.isnan(share)):
                lost.append(in_words(agent.label, agent.name))
                continue
            worst = max(worst, *(share for share in shares if not math.isnan(share)))
            misses.plot(sweep.over, shares, **line)
        misses.set_title("Trials without success (%)")
        misses.set_ylim(-0.02 * max(worst, 0.1), 1.08 * max(worst, 0.1))
        misses.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:.3g}"))
        ends = _draw_motions(motions, sweep, curves)
        motions.set_title(_NEEDED.format(sweep.env.max_episode_steps))
        for axes in (misses, motions):
            _scale(axes, sweep, 48)
        left_out = f" Left out on the left: {', '.join(lost)} (no success)." if lost else ""
        say(figure, _title(sweep), said + left_out)
        label_lines(motions, ends, 9.5)
    return figure


def sweeps_figure(sweeps: Sequence[SweepConfig], curves: Mapping[str, Curves], said: str) -> Figure:
    """Motions per reach in all sweeps, a panel each, three in a row."""
    across = min(_ACROSS, len(sweeps))
    down = math.ceil(len(sweeps) / across)
    with plt.rc_context({**STYLE, "axes.labelsize": 8.5}):
        figure = plt.figure(figsize=(2.1 * across + 2.6, 2.1 * down + 0.7), layout="constrained")
        grid = figure.subplots(down, across, squeeze=False)
        for axes, sweep in zip(grid.flat, sweeps, strict=False):
            _draw_motions(axes, sweep, curves[sweep.name])
            _scale(axes, sweep, 28)
        for axes in grid.flat[len(sweeps) :]:
            axes.set_visible(False)
        handles = {
            label: handle
            for axes in grid.flat
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside right upper")
        say(figure, _NEEDED.format(sweeps[0].env.max_episode_steps), said)
    return figure


def _draw_motions(axes: Axes, sweep: SweepConfig, curves: Curves) -> list[LineEnd]:
    motions_axis(axes, sweep.env.max_episode_steps)
    ends = []
    for agent, points, line in curves:
        words, reach = in_words(agent.label, agent.name), [point.motions.value for point in points]
        axes.plot(sweep.over, reach, **line, label=words)
        last = max((i for i, each in enumerate(reach) if not math.isnan(each)), default=None)
        if last is not None:
            ends.append(LineEnd(sweep.over[last], reach[last], words, line["color"]))
    return ends


def _scale(axes: Axes, sweep: SweepConfig, letters: int) -> None:
    """Factors are spaced by their ratios; a line below the panel has so many letters at most."""
    if sweep.vary == "factor":
        axes.set_xscale("log")
        marks(axes.xaxis, _apart(sweep.over))
    else:
        axes.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 3, 5, 6, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.set_xlabel(fill(axis_in_words(sweep), letters))


def _title(sweep: SweepConfig) -> str:
    what, _, _ = axis_in_words(sweep).partition(" (")
    return what[0].upper() + what[1:]


def _apart(factors: Sequence[float]) -> list[float]:
    """Those that are written: no two nearer than a sixth of the axis."""
    width = math.log(factors[-1] / factors[0]) if len(factors) > 1 else 1.0
    found = [factors[0]]
    for factor in factors[1:]:
        if math.log(factor / found[-1]) >= width / 6:
            found.append(factor)
    return found
