"""How every figure looks: style, palette, bands, legends, files. Drawn without a display."""

import textwrap
from collections.abc import Iterable
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from experiments.reporting.pages.section import Drawing

# Okabe and Ito's palette, distinct for all kinds of colour vision, but grey for their yellow: pale on white.
# Markers and dashes are distinct in grey.
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000", "#999999")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), "-.", (0, (3, 1, 1, 1, 1, 1)), "-", "--")
_MARGIN = 0.05  # inches around a piece
DARK_GREY, GREY = "#555555", "#8a8a8a"

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


def draw_logarithmic(axes: Axes) -> None:
    """Makes the vertical axis logarithmic, with plain numbers at 1, 2 and 5 of each power of ten."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def draw_band(
    axes: Axes,
    x: Any,
    middle: Any,
    low: Any,
    high: Any,
    label: str,
    line: dict[str, Any],
    alpha: float = 0.18,
    alone: Iterable[Any] = (),
) -> None:
    """Draws a line with its interval as a band, or with the lines of single worlds, where these are given."""
    alone = list(alone)
    for each in alone:
        axes.plot(x, each, color=line["color"], linewidth=0.5, alpha=0.45)
    if not alone:
        axes.fill_between(x, low, high, color=line["color"], alpha=alpha, linewidth=0)
    axes.plot(x, middle, label=label, **line)


def legend_below(figure: Figure, panels: Iterable[Axes], said: str, columns: int | None = None) -> None:
    """One legend below all panels, each label once, in at most `columns`; small text stands above it.

    Args:
        figure: Has the panels.
        panels: What is drawn in them is named.
        said: Its lines are broken where the figure ends.
        columns: Of the legend.
    """
    handles = {
        label: handle
        for panel in panels
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    across = max(1, len(handles) if columns is None else min(columns, len(handles)))
    letters = int(20 * figure.get_figwidth())
    lines = [line for paragraph in said.splitlines() for line in textwrap.wrap(paragraph, letters)]
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside lower center",
        ncols=across,
        title="\n".join(lines),
        title_fontproperties={"size": 6.5},
    )


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
    """A drawn figure's columns of panels, one piece each, and the lines of its legend; takes it apart."""
    figure.set_layout_engine("none")  # all stays where it was drawn
    title, said = figure.get_suptitle(), ""
    figure.suptitle("")
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
        said = " ".join(legend.get_title().get_text().splitlines())
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
