"""Success and motions against what the sweeps vary."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator, PercentFormatter

from experiments.config.suite import SweepConfig
from experiments.reporting.pages.style import GREY, STYLE, draw_band, legend_below, line_of
from experiments.reporting.sweep.estimates import Point
from experiments.statistics import Estimate

_ACROSS = 4
"""Sweeps side by side."""


def sweep_figure(
    sweeps: Sequence[SweepConfig],
    curves: Mapping[str, Mapping[str, list[Point]]],
    places: Mapping[str, int],
    said: str,
) -> Figure:
    """Success above, motions below, for each sweep; the share of trials out of view is a grey step.

    A thin line is the share that an agent's first motion brings there, where one does.

    Args:
        sweeps: From left to right, four in a row.
        curves: By the sweep's name: by each agent's label, its points.
        places: By each agent's label, which colour it has.
        said: Stands below the panels.
    """
    across = min(_ACROSS, len(sweeps))
    down = math.ceil(len(sweeps) / across)
    with plt.rc_context({**STYLE, "axes.titlepad": 6}):
        figure = plt.figure(
            figsize=(3.5 * across if across > 1 else 5, 5.4 * down + 0.8), layout="constrained"
        )
        grid = figure.subplots(2 * down, across, squeeze=False)
        for panel in grid.flat:
            panel.set_visible(False)
        for i, sweep in enumerate(sweeps):
            row, column = 2 * (i // across), i % across
            success, motions = grid[row, column], grid[row + 1, column]
            _column(success, motions, sweep, curves[sweep.name], places)
            success.set_ylabel("success rate (%)")
            motions.set_ylabel("motions of trials\nwith a rendezvous")
        legend_below(figure, grid.flat, said, columns=across + 1)
    return figure


def _column(
    success: Axes,
    motions: Axes,
    sweep: SweepConfig,
    found: Mapping[str, list[Point]],
    places: Mapping[str, int],
) -> None:
    for depth, (agent, points) in enumerate(found.items()):
        line = line_of(places[agent])
        _draw(success, [(p.value, p.success) for p in points], agent, line, depth)
        _draw(motions, [(p.value, p.among_reached) for p in points], agent, line, depth)
        if any(p.at_once for p in points):
            thin = {**line, "marker": "", "linewidth": 0.8}
            success.plot(sweep.over, [p.at_once for p in points], label=f"{agent}, its first motion", **thin)
    out_of_view = [1 - p.trials / p.worlds for p in next(iter(found.values()))]
    if any(out_of_view):
        grey: Any = {"color": GREY, "alpha": 0.6, "linewidth": 0, "step": "mid"}
        success.fill_between(sweep.over, out_of_view, label="trials out of view", **grey)
    for axes in (success, motions):
        axes.set_visible(True)
        _scale(axes, sweep)
    success.set_title(sweep.name.replace("_", " "))
    success.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
    success.set_ylim(-0.03, 1.05)
    success.tick_params(labelbottom=False)
    motions.set_ylim(0, sweep.env.max_episode_steps * 1.05)
    motions.set_xlabel(_axis(sweep))


def _draw(
    axes: Axes, curve: list[tuple[float, Estimate | None]], agent: str, line: dict[str, Any], depth: int
) -> None:
    """A line with its band; the first agents lie on top, with smaller markers, so that all are seen."""
    values = [value for value, _ in curve]
    middle, low, high = (
        [math.nan if found is None else getattr(found, edge) for _, found in curve]
        for edge in ("value", "low", "high")
    )
    line = {**line, "markersize": 3 + 0.8 * depth, "zorder": 10 - 0.1 * depth}
    draw_band(axes, values, middle, low, high, label=agent, line=line, alpha=0.15)


def _scale(axes: Axes, sweep: SweepConfig) -> None:
    """Factors are spaced by their ratios."""
    if sweep.vary == "factor":
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(list(sweep.over)))
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 2.5, 3, 5, 6, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _axis(sweep: SweepConfig) -> str:
    where = " ".join(str(value) for key, value in sweep.do.items() if key != "type")
    return f"{sweep.do['type']} {where}: {sweep.vary}" if where else f"{sweep.do['type']}: {sweep.vary}"
