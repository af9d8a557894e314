"""How every figure looks: style, axes, worlds, captions, labels, agents, files. Drawn without a display."""

import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from matplotlib.transforms import Bbox

from calfree_gym.files import whole
from experiments.config.suite import AgentConfig
from experiments.reporting.pages import Drawing
from experiments.statistics import ENOUGH_WORLDS, Array

_MARGIN = 0.05  # inches around a piece
DARK_GREY = "#555555"
_BANDED = 3
"""With more agents in a panel, bands cover each other, and are left out."""

_BEYOND = 0.05
"""Share of the panel's height by which labels may stand above and below it."""
_OUT, _ELBOW = 12, 3  # points: from the panel to the words, and of it straight on

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
    marks(axes.yaxis, [*(mark for mark in (1, 2, 5, 10, 20, 50) if mark < 0.7 * cap), cap])
    axes.set_ylim(0.9, 1.15 * cap)


def marks(axis: Axis, at: Sequence[float]) -> None:
    """Writes these numbers on an axis, and no others."""
    axis.set_major_locator(FixedLocator(at))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter("{x:g}")


def draw_worlds(axes: Axes, x: Any, worlds: Array, line: Line, agents: int) -> None:
    """Draws the median of worlds (worlds, points) at places (points,), and how they differ.

    `drawn_in_words` says how; so many agents are drawn in the panel, one after the other.
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
        return f"Lines: the median world; thin: each world, where there are fewer than {ENOUGH_WORLDS}."
    if agents <= _BANDED:
        return "Lines: the median world; bands: the 10th to 90th percentile of worlds."
    return "Lines: the median world."


def say(figure: Figure, title: str, said: str) -> None:
    """What the figure shows stands above it, how to read it below, in lines as long as it is wide."""
    figure.suptitle(title, x=0.005, ha="left", weight="bold", size=11)
    letters = int(15 * figure.get_figwidth())
    figure.supxlabel(fill(said, letters), x=0.005, ha="left", size=8.5, color=DARK_GREY)


@dataclass(frozen=True, slots=True)
class LineEnd:
    """Where a line ends, in the units of its axes, and the words beside it, in one or several lines."""

    x: float
    y: float
    words: str
    colour: Any


def label_lines(axes: Axes, ends: Sequence[LineEnd], size: float) -> None:
    """Writes a label beside the panel for each line, and leads to it from where the line ends.

    The figure is laid out here: the panel must have its scales, its limits and its neighbours, and none to
    its right.
    """
    figure = axes.figure
    texts = [
        axes.annotate(
            end.words, (1, 0), (_OUT + 3, 0), axes.transAxes, "offset points", color=end.colour,
            fontsize=size, va="center", linespacing=1.05, annotation_clip=False,
        )
        for end in ends
    ]  # fmt: skip
    figure.draw_without_rendering()  # type: ignore[union-attr]
    panel = axes.get_window_extent()
    heights = np.array([text.get_window_extent().height for text in texts]) / panel.height
    at = np.array([_in_panel(axes, end)[1] for end in ends])
    a_point = figure.dpi / 72 / panel.width
    for end, text, start, place in zip(ends, texts, at, spread(at, 1.08 * heights), strict=True):
        text.xy = (1, float(place))
        x, _ = _in_panel(axes, end)
        axes.plot(
            [x, 1 + _ELBOW * a_point, 1 + _OUT * a_point], [start, start, place], color=end.colour,
            transform=axes.transAxes, linewidth=0.7, alpha=0.55, clip_on=False, zorder=1,
        )  # fmt: skip


def spread(at: NDArray[np.float64], heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places near those wanted, in their order, no two nearer than what stands there is high."""
    order = np.argsort(at, kind="stable")
    middles = np.cumsum(heights[order]) - heights[order] / 2
    groups: list[tuple[float, int]] = []  # mean of what is wanted less what is taken below, and members
    for wanted in at[order] - middles:
        groups.append((float(wanted), 1))
        while len(groups) > 1 and groups[-2][0] > groups[-1][0]:
            (low, some), (high, more) = groups.pop(-2), groups.pop()
            groups.append(((low * some + high * more) / (some + more), some + more))
    room = max(1 + 2 * _BEYOND - heights.sum(), 0)  # beside the panel, if there is any
    bottom = np.clip([base for base, _ in groups], -_BEYOND, room - _BEYOND)
    found = np.empty(len(at))
    found[order] = np.repeat(bottom, [count for _, count in groups]) + middles
    return found


def _in_panel(axes: Axes, end: LineEnd) -> tuple[float, float]:
    """Shares of the panel's width and height."""
    x, y = axes.transAxes.inverted().transform(axes.transData.transform((end.x, end.y)))
    return float(x), float(y)


def save(figure: Figure, folder: Path, name: str) -> Drawing:
    """Writes a figure as PNG and SVG, and returns it in the pieces of a page."""
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for kind, options in (("png", {"dpi": 160}), ("svg", {"metadata": {"Date": None}})):
            with whole(folder / f"{name}.{kind}") as file:
                figure.savefig(file, format=kind, **options)
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


@dataclass(frozen=True, slots=True)
class _Known:
    words: str
    colour: str
    dash: Any = "-"


_DASHED, _DOTTED, _DASH_DOT = (0, (4, 1.6)), (0, (1.4, 1.2)), (0, (5, 1.2, 1.2, 1.2))
_LONG = (0, (9, 1.6))

# Okabe and Ito's hues, darkened until text in them is read on white (contrast of 4.5 and more), and others
# between them. Agents that share one are of a kind, and their dashes differ.
_GREEN, _VERMILION, _PINK, _SKY = "#007F5F", "#B84300", "#A3156F", "#1A7DB6"
_BLUE, _AMBER, _BLACK, _GREY = "#003F8F", "#946E00", "#000000", "#757575"
_PURPLE, _RED, _OLIVE, _TEAL = "#6F4BC0", "#8C1C13", "#5F6B00", "#00707A"

ASIDE = ("oracle", "random")
"""Ceiling and floor: thin grey lines."""

_KNOWN = {
    "oracle": _Known("oracle: told where to go", _GREY),
    "random": _Known("random motions", _GREY, _DASHED),
    "paper_servo": _Known("test-motion servo (1995)", _GREEN),
    "work_plane_servo": _Known("work-plane servo (1995)", _GREEN, _DASHED),
    "joint_space_servo": _Known("Conkie & Chongstitvatana (1990)", _GREEN, _DOTTED),
    "grid_table": _Known("servo with table (1997)", _VERMILION),
    "factored_table": _Known("factored table (ours)", _VERMILION, _DASHED),
    "support_points": _Known("support points (ours)", _VERMILION, _DOTTED),
    "memory": _Known("memory (ours)", _PINK),
    "polynomial": _Known("polynomial regression", _SKY, _DASHED),
    "simulation_prior": _Known("regression with simulated prior", _SKY, _DOTTED),
    "body_schema": _Known("body schema (ours)", _RED),
    "cooperstock_milios": _Known("Cooperstock & Milios (1993)", _SKY),
    "self_supervised": _Known("self-supervised network (ours)", _BLUE),
    "recurrent_servo": _Known("pretrained network (ours)", _OLIVE),
    "in_context": _Known("pretrained network that remembers (ours)", _OLIVE, _DASHED),
    "unified_servo": _Known("unified servo (ours)", _PURPLE),
    "jacobian_servo": _Known("Jacobian servo", _PURPLE, _DASHED),
    "arcs": _Known("arcs by a projective model (ours)", _BLUE, _DASHED),
    "commuting_servo": _Known("commuting servo (ours)", _PINK, _DASHED),
    "safe_start": _Known("careful start (ours)", _PURPLE, _DOTTED),
    "affine_stereo": _Known("Hollinghurst & Cipolla (1994)", _TEAL),
    "model_based": _Known("calibrated robot", _RED, _DASHED),
    "self_calibrating": _Known("self-calibrating robot", _RED, _DOTTED),
    "ppo": _Known("PPO (stable-baselines3)", _BLACK),
    "recurrent_ppo": _Known("recurrent PPO (sb3-contrib)", _BLACK, _DASHED),
    "sac": _Known("SAC (stable-baselines3)", _AMBER, _LONG),
    "sac_her": _Known("SAC with hindsight (stable-baselines3)", _AMBER, _DASHED),
    "td3": _Known("TD3 (stable-baselines3)", _AMBER, _DOTTED),
    "crossq": _Known("CrossQ (sb3-contrib)", _AMBER, _DASH_DOT),
    "tqc": _Known("TQC (sb3-contrib)", _BLACK, _DOTTED),
    "grasp": _Known("grasping servo (ours)", _TEAL, _DASHED),
    "insert": _Known("inserting servo (ours)", _TEAL, _DOTTED),
    "yoshimi_allen": _Known("Yoshimi & Allen (1994)", _GREEN, _DASH_DOT),
}
_OTHERS = (_GREEN, _VERMILION, _PINK, _SKY, _BLUE, _AMBER, _PURPLE, _RED, _OLIVE, _TEAL)
_SHADES = (0.35, -0.22)
"""A variant is darker, or lighter: so far towards black, or (negative) towards white."""
_OF_VARIANTS = [(shade, dash) for dash in (_DASHED, _DOTTED, "-", _DASH_DOT) for shade in _SHADES]


def in_words(label: str, name: str) -> str:
    """What an agent is called in figures and tables; a label of its own stays as it is."""
    return _KNOWN[name].words if label == name and name in _KNOWN else label


def colour(label: str, name: str) -> str:
    """The colour of an agent, as "#rrggbb"; variants, which have labels of their own, have their kind's."""
    if name in _KNOWN:
        return _KNOWN[name].colour
    return _OTHERS[zlib.crc32(label.encode()) % len(_OTHERS)]


def lines_of(agents: Sequence[AgentConfig]) -> dict[str, dict[str, Any]]:
    """How the lines of a suite's agents are drawn, by their labels.

    An agent that is called by its name looks the same in every suite. One or two variants are shades of it,
    with dashes of their own; more have hues that no other agent of the suite has, while there are any.
    """
    lines: dict[str, dict[str, Any]] = {}
    own = [colour(agent.label, agent.name) for agent in agents]
    free = [hue for hue in _OTHERS if hue not in own]
    of_kind = Counter(hue for agent, hue in zip(agents, own, strict=True) if agent.label != agent.name)
    variants = Counter[str]()
    for agent, base in zip(agents, own, strict=True):
        line: dict[str, Any] = {"color": base, "linestyle": "-"}
        if agent.label == agent.name:
            line["linestyle"] = _KNOWN[agent.name].dash if agent.name in _KNOWN else "-"
        elif of_kind[base] > 2 and free:
            line["color"] = free.pop(0)
        else:
            shade, line["linestyle"] = _OF_VARIANTS[variants[base] % len(_OF_VARIANTS)]
            line["color"] = _towards(base, shade)
            variants[base] += 1
        aside = agent.name in ASIDE
        line |= {"linewidth": 1 if aside else 2, "marker": "" if aside else "o", "markersize": 2.6}
        lines[agent.label] = line
    return lines


def _towards(base: str, shade: float) -> str:
    """So far towards black or, where it is negative, towards white."""
    end = 0.0 if shade > 0 else 1.0
    red, green, blue = (part + abs(shade) * (end - part) for part in to_rgb(base))
    return to_hex((red, green, blue))
