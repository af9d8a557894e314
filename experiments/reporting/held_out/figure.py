"""The learning curves of held-out trials and of the agents' own."""

from collections.abc import Callable, Mapping

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, PercentFormatter

from experiments.reporting.finished_suite import (
    ENOUGH_WORLDS,
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    Perturbation,
)
from experiments.reporting.held_out.estimates import Curve
from experiments.reporting.pages.style import (
    DARK_GREY,
    STYLE,
    draw_band,
    draw_logarithmic,
    legend_below,
    line_of,
)

_ROOM_FOR_WORDS = 1  # labels above a panel


def learning_curves(
    title: str,
    curve_of: Callable[[str, str], Curve],
    places: Mapping[str, int],
    cap: int,
    perturbations: tuple[Perturbation, ...],
    said: str,
) -> Figure:
    """Success, observed rendezvous and motions per reach, side by side, against lifetime motions.

    Args:
        title: Stands above the panels.
        curve_of: From an agent's label and a measure to its curve.
        places: By each agent's label, which colour it has.
        cap: Motions after which a trial has failed.
        perturbations: Each is marked by a line, or by a span where runs were perturbed at different motions.
        said: Stands below the panels.
    """
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 3, figsize=(13, 4.7), layout="constrained")
        for axes, measure in zip(panels, (SUCCESS, RENDEZVOUS, MOTIONS), strict=True):
            for agent, index in places.items():
                _draw(axes, curve_of(agent, measure), agent, index)
        left, middle, right = panels
        left.set_title("Success: true error within the tolerance")
        middle.set_title("Observed rendezvous")
        for axes in (left, middle):
            axes.set_ylabel("trials (%)")
            axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
            axes.set_ylim(-0.03, 1.05)
        right.set_title(f"Motions per reach (a failure counts as {cap})")
        right.set_ylabel("motions, median world")
        draw_logarithmic(right)
        right.set_ylim(0.9, cap * 1.2)
        for axes in panels:
            axes.set_xlabel("lifetime motions")
            axes.set_xlim(left=0)
            axes.xaxis.set_major_locator(MaxNLocator(6))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.0f}"))
            _mark(axes, perturbations)
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        legend_below(figure, [left], said, columns=6)
    return figure


def _draw(axes: Axes, curve: Curve, agent: str, index: int) -> None:
    found = curve.estimates()
    value, low, high = ([getattr(each, edge) for each in found] for edge in ("value", "low", "high"))
    alone = curve.runs if len(curve.runs) < ENOUGH_WORLDS else ()
    x = curve.motions[: len(found)]
    draw_band(axes, x, value, low, high, label=agent, line=line_of(index), alone=alone)


def _mark(axes: Axes, perturbations: tuple[Perturbation, ...]) -> None:
    """Dotted lines or grey spans, with words above the axes where there is room for them."""
    for perturbation in perturbations:
        if perturbation.first == perturbation.last:
            axes.axvline(perturbation.first, color=DARK_GREY, linewidth=1, linestyle=":")
        else:
            axes.axvspan(perturbation.first, perturbation.last, color=DARK_GREY, alpha=0.12, linewidth=0)
    if len(perturbations) <= _ROOM_FOR_WORDS:
        for perturbation in perturbations:
            axes.annotate(
                perturbation.what,
                ((perturbation.first + perturbation.last) / 2, 1),
                xycoords=("data", "axes fraction"),
                xytext=(0, 3),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color=DARK_GREY,
            )
