"""Failures and motions against what the sweeps vary."""

import math
from collections.abc import Mapping, Sequence
from textwrap import fill

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from experiments.config.suite import AgentConfig, SweepConfig
from experiments.reporting.agents_in_words import in_words
from experiments.reporting.pages.labels import LineEnd, label_lines
from experiments.reporting.pages.perturbations_in_words import axis_in_words
from experiments.reporting.pages.style import STYLE, Line, motions_axis, say
from experiments.reporting.sweep.estimates import Point

_ACROSS = 3
"""Sweeps side by side."""
_LOST = 0.95
"""An agent that misses more than this share of all trials at every value has no line among the misses."""
_NEEDED = "Motions per reach, mean (a failure: {})"

Curves = Sequence[tuple[AgentConfig, list[Point], Line]]
"""Of each agent, with its line."""


def sweep_figure(sweep: SweepConfig, curves: Curves, said: str) -> Figure:
    """Trials that end off the object on the left, and motions per reach on the right, both against the value.

    Args:
        sweep: What is varied.
        curves: Of all agents.
        said: Stands below the panels.
    """
    with plt.rc_context(STYLE):
        figure, (misses, motions) = plt.subplots(1, 2, figsize=(8.6, 4), layout="constrained")
        lost, worst = [], 0.0
        for agent, points, line in curves:
            shares = [1 - p.success.value if p.success else math.nan for p in points]
            if all(share > _LOST for share in shares if not math.isnan(share)):
                lost.append(in_words(agent.label, agent.name))
                continue
            worst = max(worst, *(share for share in shares if not math.isnan(share)))
            misses.plot(sweep.over, shares, **line)
        misses.set_title("Trials that end off the object (%)")
        misses.set_ylim(-0.02 * max(worst, 0.1), 1.08 * max(worst, 0.1))
        misses.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:.3g}"))
        ends = _draw_motions(motions, sweep, curves)
        motions.set_title(_NEEDED.format(sweep.env.max_episode_steps))
        for axes in (misses, motions):
            _scale(axes, sweep, 48)
        left_out = f" Left out on the left: {', '.join(lost)} (misses all)." if lost else ""
        say(figure, _title(sweep), said + left_out)
        label_lines(motions, ends, 9.5)
    return figure


def sweeps_figure(sweeps: Sequence[SweepConfig], curves: Mapping[str, Curves], said: str) -> Figure:
    """Motions per reach in all sweeps, a panel each, three in a row.

    Args:
        sweeps: In their order.
        curves: By the sweep's name.
        said: Stands below the panels.
    """
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
        words, reach = in_words(agent.label, agent.name), [_motions(point) for point in points]
        axes.plot(sweep.over, reach, **line, label=words)
        last = max((i for i, each in enumerate(reach) if not math.isnan(each)), default=None)
        if last is not None:
            ends.append(LineEnd(sweep.over[last], reach[last], words, line["color"]))
    return ends


def _motions(point: Point) -> float:
    return point.motions.value if point.motions else math.nan


def _scale(axes: Axes, sweep: SweepConfig, letters: int) -> None:
    """Factors are spaced by their ratios; a line below the panel has so many letters at most."""
    if sweep.vary == "factor":
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(_apart(sweep.over)))
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 3, 5, 6, 10]))
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
