"""The one figure of held-out trials: motions per reach against motions lived, and those since a knock."""

from dataclasses import dataclass
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.config.in_words import again_and_again, later_knocks, schedule_in_words
from experiments.config.suite import AgentConfig, ScenarioConfig
from experiments.reporting.figures import (
    ASIDE,
    STYLE,
    Line,
    LineEnd,
    draw_worlds,
    drawn_in_words,
    in_words,
    label_lines,
    lines_of,
    marks,
    motions_axis,
    say,
)
from experiments.reporting.finished_suite import MOTIONS, FinishedSuite, where_it_stands
from experiments.reporting.held_out import HeldOut
from experiments.statistics import Array

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
    known = later_knocks(scenario)
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
    known = later_knocks(scenario)
    if known is None:
        return again_and_again(scenario) or schedule_in_words(scenario)
    if not known:
        return schedule_in_words(scenario)
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
