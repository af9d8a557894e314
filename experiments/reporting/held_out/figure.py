"""The learning curves, drawn without a display."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, PercentFormatter

from experiments.reporting.held_out.summary import MOTIONS, SUCCESS, Curve

# Okabe and Ito's palette, told apart by all colour visions; markers and dashes tell apart in grey.
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), "-.", (0, (3, 1, 1, 1, 1, 1)), "-", "--")
_ROOM_FOR_WORDS = 2  # labels side by side above a panel

STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 18,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "svg.hashsalt": "calfree",
}


@dataclass(frozen=True, slots=True)
class Perturbation:
    """How the world changed, and between which lifetime motions (or trials) it did so in the runs."""

    first: int
    last: int
    what: str


def learning_curves(
    title: str,
    curve_of: Callable[[str, str], Curve],
    agents: tuple[str, ...],
    cap: int,
    perturbations: tuple[Perturbation, ...],
) -> Figure:
    """Success and motions per reach, side by side, against lifetime motions.

    Args:
        title: Stands above both panels.
        curve_of: From an agent's label and a measure to its curve.
        agents: The labels, in the order of their colours.
        cap: Motions after which a trial has failed.
        perturbations: Each is marked by a line, or by a span where runs were perturbed at different motions.
    """
    with plt.rc_context(STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.3), layout="constrained")
        for index, agent in enumerate(agents):
            _draw(left, curve_of(agent, SUCCESS), agent, index)
            _draw(right, curve_of(agent, MOTIONS), agent, index)
        left.set_title("Trials that reach the object")
        left.set_ylabel("success rate (%)")
        left.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
        left.set_ylim(-0.03, 1.05)
        right.set_title(f"Motions per reach (a failure counts as {cap})")
        right.set_ylabel("motions")
        right.set_ylim(0, cap * 1.05)
        for axes in (left, right):
            axes.set_xlabel("lifetime motions")
            axes.set_xlim(left=0)
            axes.xaxis.set_major_locator(MaxNLocator(6))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.0f}"))
            _mark(axes, perturbations)
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=max(1, len(labels)))
    return figure


def line_of(index: int) -> dict[str, Any]:
    """How the line of the agent with this index is drawn, in every figure."""
    again = index // len(_COLOURS)  # a colour that comes again has another marker and other dashes
    return {
        "color": _COLOURS[index % len(_COLOURS)],
        "linestyle": _DASHES[(index + again) % len(_DASHES)],
        "marker": _MARKERS[(index + again) % len(_MARKERS)],
        "markersize": 4,
        "linewidth": 1.6,
    }


def save(figure: Figure, folder: Path, name: str) -> str:
    """Writes a figure as PNG and SVG, and returns the SVG's text."""
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        figure.savefig(folder / f"{name}.png", dpi=160)
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)
    return (folder / f"{name}.svg").read_text(encoding="utf-8")


def _draw(axes: Axes, curve: Curve, agent: str, index: int) -> None:
    line = line_of(index)
    low, high = curve.band()
    axes.fill_between(curve.motions, low, high, color=line["color"], alpha=0.18, linewidth=0)
    axes.plot(curve.motions, curve.mean, label=agent, **line)


def _mark(axes: Axes, perturbations: tuple[Perturbation, ...]) -> None:
    """Dotted lines or grey spans, with words above the axes where there is room for them."""
    for perturbation in perturbations:
        if perturbation.first == perturbation.last:
            axes.axvline(perturbation.first, color="#555555", linewidth=1, linestyle=":")
        else:
            axes.axvspan(perturbation.first, perturbation.last, color="#555555", alpha=0.12, linewidth=0)
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
                color="#555555",
            )
