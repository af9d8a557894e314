"""The learning curves of lifetimes counted in trials, on an axis whose blocks widen after each event."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.reporting.by_trial.estimates import LOOKS, Blocks, seconds_at
from experiments.reporting.finished_suite import ENOUGH_WORLDS, MOTIONS, Perturbation
from experiments.reporting.pages.style import (
    DARK_GREY,
    STYLE,
    draw_band,
    draw_logarithmic,
    legend_below,
    line_of,
)
from experiments.statistics import Array

_ROOM_FOR_WORDS = 5  # labels side by side above the panels


def trial_curves(
    title: str,
    blocks_of: Callable[[str, str], Blocks],
    places: Mapping[str, int],
    edges: Array,
    perturbations: Sequence[Perturbation],
    said: str,
) -> Figure:
    """Motions per reach above robot seconds per reach; every block of trials has the same width.

    Robot seconds are a band from the shortest to the longest look, with a line between them.

    Args:
        title: Stands above both panels.
        blocks_of: From an agent's label and a measure to its blocks.
        places: By each agent's label, which colour it has.
        edges: Where the blocks begin and end.
        perturbations: Marked where they fall, between trials.
        said: Stands below the panels.
    """
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(2, 1, figsize=(7, 8), sharex=True, layout="constrained")
        above, below = panels
        for agent, index in places.items():
            _draw(above, blocks_of(agent, MOTIONS), agent, index)
            _draw_looks(below, [blocks_of(agent, seconds_at(look)) for look in LOOKS], agent, index)
        above.set_ylabel("motions a reach,\nmedian world")
        below.set_ylabel(
            f"robot seconds per reach\n{LOOKS[0]:g} to {LOOKS[2]:g} s a look, line: {LOOKS[1]:g} s"
        )
        for axes in panels:
            draw_logarithmic(axes)
            for perturbation in perturbations:
                axes.axvline(_place(edges, perturbation.first), color=DARK_GREY, linewidth=1, linestyle=":")
        _name_blocks(panels[1], edges)
        _name_events(panels[0], edges, perturbations)
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        legend_below(figure, [panels[0]], said, columns=3)
    return figure


def _draw(axes: Axes, blocks: Blocks, agent: str, index: int) -> None:
    found = blocks.estimates()
    middle, low, high = zip(*((e.value, e.low, e.high) for e in found), strict=True)
    alone = blocks.runs if len(blocks.runs) < ENOUGH_WORLDS else ()
    place = np.arange(len(found)) + 0.5
    draw_band(axes, place, middle, low, high, label=agent, line=line_of(index), alone=alone)


def _draw_looks(axes: Axes, looks: Sequence[Blocks], agent: str, index: int) -> None:
    low, middle, high = (np.median(blocks.runs, axis=0) for blocks in looks)
    draw_band(axes, np.arange(len(middle)) + 0.5, middle, low, high, label=agent, line=line_of(index))


def _place(edges: Array, trial: float) -> float:
    """Where on the axis this many trials have gone."""
    return float(np.interp(trial, edges, np.arange(len(edges))))


def _name_blocks(axes: Axes, edges: Array) -> None:
    names = [span(first, end) for first, end in pairwise(edges)]
    axes.set_xticks(np.arange(len(names)) + 0.5, names, rotation=60, ha="right", rotation_mode="anchor")
    axes.tick_params(axis="x", labelsize=8)
    axes.set_xlim(0, len(names))
    axes.set_xlabel("trials")


def _name_events(axes: Axes, edges: Array, perturbations: Sequence[Perturbation]) -> None:
    for perturbation in perturbations if len(perturbations) <= _ROOM_FOR_WORDS else ():
        axes.annotate(
            perturbation.what.replace(" (", "\n("),
            (_place(edges, perturbation.first), 1),
            xycoords=("data", "axes fraction"),
            xytext=(2, 3),
            textcoords="offset points",
            fontsize=8,
            color=DARK_GREY,
        )


def span(first: float, end: float) -> str:
    """The trials of a block in words, counted from 1."""
    return f"{end:,.0f}" if end == first + 1 else f"{first + 1:,.0f}–{end:,.0f}"
