"""Success and motions against what the sweeps vary: a column a sweep."""

import math
from collections.abc import Callable, Sequence

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from experiments.config import SweepConfig
from experiments.figures import STYLE, line_of
from experiments.summary import Cell
from experiments.sweep_summary import Point

_TICKS = 9
"""More values than these have a label only at every other one."""


def sweep_figure(
    sweeps: Sequence[SweepConfig], points_of: Callable[[SweepConfig, str], list[Point]], agents: Sequence[str]
) -> Figure:
    """Success above, motions below; the share of trials out of view is grey.

    Args:
        sweeps: One a column.
        points_of: From a sweep and an agent's label to its points.
        agents: The labels, in the order of their colours.
    """
    with plt.rc_context(STYLE):
        width = 8.0 if len(sweeps) == 1 else 3.6 * len(sweeps)
        figure, rows = plt.subplots(
            2,
            len(sweeps),
            figsize=(width, 6.4),
            sharex="col",
            sharey="row",
            squeeze=False,
            layout="constrained",
        )
        for column, sweep in enumerate(sweeps):
            success, motions = rows[:, column]
            for index, agent in enumerate(agents):
                found = points_of(sweep, agent)
                _draw(success, [(p.value, p.success) for p in found], agent, index)
                _draw(motions, [(p.value, p.motions) for p in found], agent, index)
            _scale(motions, sweep)
            success.set_title(sweep.name)
            motions.set_xlabel(_axis(sweep))
        rows[0, 0].set_ylabel("success rate (%)")
        rows[0, 0].yaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
        rows[0, 0].set_ylim(-0.03, 1.05)
        rows[1, 0].set_ylabel("motions, median of successes")
        rows[1, 0].set_ylim(bottom=0)
        handles, labels = rows[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _draw(axes: Axes, curve: list[tuple[float, Cell | None]], agent: str, index: int) -> None:
    line = line_of(index)
    values = [value for value, _ in curve]
    middle, low, high = (
        [math.nan if cell is None else getattr(cell, edge) for _, cell in curve]
        for edge in ("value", "low", "high")
    )
    axes.fill_between(values, low, high, color=line["color"], alpha=0.15, linewidth=0)
    axes.plot(values, middle, label=agent, **line)


def _scale(axes: Axes, sweep: SweepConfig) -> None:
    """A tick at the values that were swept; factors are spaced by their ratios."""
    if sweep.vary == "factor":
        axes.set_xscale("log")
    shown = sweep.over[:: 2 if len(sweep.over) > _TICKS else 1]
    axes.xaxis.set_major_locator(FixedLocator(list(shown)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _axis(sweep: SweepConfig) -> str:
    where = ", ".join(str(value) for key, value in sweep.do.items() if key != "type")
    what = f"{sweep.do['type']}: {sweep.vary}"
    return f"{what} ({where})" if where else what
