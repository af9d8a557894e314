"""The learning curves of lifetimes counted in trials, on an axis whose blocks widen after each event."""

from collections.abc import Sequence
from itertools import pairwise
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.config.suite import AgentConfig
from experiments.reporting.agents_in_words import in_words
from experiments.reporting.by_trial.estimates import Blocks
from experiments.reporting.pages.labels import LineEnd, label_lines
from experiments.reporting.pages.perturbations_in_words import Knock
from experiments.reporting.pages.style import DARK_GREY, STYLE, Line, draw_worlds, motions_axis, say
from experiments.statistics import Array

_ROOM = 18
"""Letters of what happened, in a line above the panel."""


def trial_curves(
    title: str,
    curves: Sequence[tuple[AgentConfig, Blocks, Line]],
    cap: int,
    knocks: Sequence[Knock],
    said: str,
) -> Figure:
    """Motions per reach; every block of trials has the same width.

    Args:
        title: Stands above.
        curves: Of each agent, with its line.
        cap: Motions after which a trial has failed.
        knocks: Marked where they fall, between trials, where that is known.
        said: Stands below the panel.
    """
    edges = curves[0][1].edges
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(7.6, 4.3), layout="constrained")
        motions_axis(axes, cap)
        place, ends = np.arange(len(edges) - 1) + 0.5, []
        for agent, blocks, line in curves:
            draw_worlds(axes, place, blocks.runs, line, len(curves))
            end = float(np.median(blocks.runs[:, -1]))
            ends.append(LineEnd(place[-1], end, in_words(agent.label, agent.name), line["color"]))
        _name_blocks(axes, edges)
        for knock in knocks:
            if knock.trial:
                _mark(axes, float(np.interp(knock.trial, edges, np.arange(len(edges)))), knock.words)
        say(figure, title, said)
        label_lines(axes, ends, 10)
    return figure


def _mark(axes: Axes, place: float, words: str) -> None:
    axes.axvline(place, color=DARK_GREY, linewidth=1.2)
    words = fill(words, _ROOM)
    axes.annotate(
        words, (place, 1), (0, 3), ("data", "axes fraction"), "offset points", fontsize=9, ha="center"
    )


def _name_blocks(axes: Axes, edges: Array) -> None:
    names = [span(first, end) for first, end in pairwise(edges)]
    axes.set_xticks(np.arange(len(names)) + 0.5, names, rotation=60, ha="right", rotation_mode="anchor")
    axes.tick_params(axis="x", labelsize=8)
    axes.set_xlim(0, len(names))
    axes.set_xlabel("trials")


def span(first: float, end: float) -> str:
    """The trials of a block in words, counted from 1."""
    return f"{end:,.0f}" if end == first + 1 else f"{first + 1:,.0f}–{end:,.0f}"
