"""How every figure looks: style, axes, worlds, captions, files. Drawn without a display."""

from collections.abc import Iterable
from io import StringIO
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from matplotlib.transforms import Bbox

from experiments.reporting.finished_suite import ENOUGH_WORLDS
from experiments.reporting.pages.section import Drawing
from experiments.statistics import Array

_MARGIN = 0.05  # inches around a piece
DARK_GREY = "#555555"
_BANDED = 3
"""With more agents in a panel, bands cover each other, and are left out."""

Line = dict[str, Any]
"""How a line is drawn; see `lines_of`."""
STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "svg.hashsalt": "calfree",
}


def motions_axis(axes: Axes, cap: int) -> None:
    """Makes the vertical axis one of motions per reach, logarithmic, from 1 to the cap of a failure."""
    axes.set_yscale("log")
    marks = [*(mark for mark in (1, 2, 5, 10, 20, 50) if mark < 0.7 * cap), cap]
    axes.yaxis.set_major_locator(FixedLocator(marks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylim(0.9, 1.15 * cap)


def draw_worlds(axes: Axes, x: Any, worlds: Array, line: Line, agents: int) -> None:
    """Draws the median world, and how worlds differ; `drawn_in_words` says how.

    Args:
        axes: The panel.
        x: Places (points,).
        worlds: What each world has come to at each of them (worlds, points).
        line: How it is drawn.
        agents: Drawn in the panel, one after the other.
    """
    if len(worlds) < ENOUGH_WORLDS:
        axes.plot(x, worlds.T, color=line["color"], linewidth=0.5, alpha=0.25)
    elif agents <= _BANDED:
        low, high = np.percentile(worlds, (10, 90), axis=0)
        axes.fill_between(x, low, high, color=line["color"], alpha=0.15, linewidth=0)
    middle = np.median(worlds, axis=0)
    axes.plot(x, middle, **line)


def drawn_in_words(worlds: int, agents: int) -> str:
    """What the lines of `draw_worlds` are."""
    if worlds < ENOUGH_WORLDS:
        return "Lines: the median world; thin: each world."
    if agents <= _BANDED:
        return "Lines: the median world; bands: the 10th to 90th percentile of worlds."
    return "Lines: the median world."


def say(figure: Figure, title: str, said: str) -> None:
    """What the figure shows stands above it, how to read it below, in lines as long as it is wide."""
    figure.suptitle(title, x=0.005, ha="left", weight="bold", size=11)
    letters = int(15 * figure.get_figwidth())
    figure.supxlabel(fill(said, letters), x=0.005, ha="left", size=8.5, color=DARK_GREY)


def save(figure: Figure, folder: Path, name: str) -> Drawing:
    """Writes a figure as PNG and SVG, and returns it in the pieces of a page."""
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        figure.savefig(folder / f"{name}.png", dpi=160)
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
        found = _in_pieces(figure)
    plt.close(figure)
    return found


def _in_pieces(figure: Figure) -> Drawing:
    """A drawn figure's columns of panels, one piece each, and the lines of its legends; takes it apart."""
    figure.set_layout_engine("none")  # all stays where it was drawn
    title, said = figure.get_suptitle(), " ".join(figure.get_supxlabel().splitlines())
    say(figure, "", "")
    columns: dict[int, list[Axes]] = {}
    for axes in figure.axes:
        if axes.get_visible():
            place = axes.get_subplotspec()
            columns.setdefault(place.colspan.start if place else len(columns), []).append(axes)
    legends = list(figure.legends)
    for artist in (*figure.axes, *legends):
        artist.set_visible(False)
    panels = tuple(_piece(figure, column) for column in columns.values())
    lines = []
    for legend in legends:
        handles: list[Any] = legend.legend_handles
        for handle, text in zip(handles, legend.get_texts(), strict=True):
            alone = figure.legend([handle], [""], handletextpad=0, borderpad=0.1)
            alone.set_visible(False)
            lines.append((_piece(figure, [alone]), text.get_text()))
    return Drawing(title, panels, tuple(lines), said)


def _piece(figure: Figure, artists: Iterable[Artist]) -> str:
    """The SVG of some artists, all others being hidden."""
    for artist in artists:
        artist.set_visible(True)
    around = Bbox.union([box for artist in artists if (box := artist.get_tightbbox())])
    inches = around.transformed(figure.dpi_scale_trans.inverted()).padded(_MARGIN)
    text = StringIO()
    figure.savefig(text, format="svg", bbox_inches=inches, metadata={"Date": None})
    for artist in artists:
        artist.set_visible(False)
    return text.getvalue()
