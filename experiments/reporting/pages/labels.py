"""Labels at the right ends of lines, spread so that none covers another."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

_BEYOND = 0.05
"""Share of the panel's height by which labels may stand above and below it."""
_OUT, _ELBOW = 12, 3  # points: from the panel to the words, and of it straight on


@dataclass(frozen=True, slots=True)
class LineEnd:
    """Where a line ends, in the units of its axes, and what stands beside it.

    Attributes:
        x, y: The end.
        words: May have several lines.
        colour: Of the words, and of the thin line that leads to them.
    """

    x: float
    y: float
    words: str
    colour: Any


def label_lines(axes: Axes, ends: Sequence[LineEnd], size: float) -> None:
    """Writes a label beside the panel for each line, and leads to it from where the line ends.

    The figure is laid out here: the panel must have its scales, its limits and its neighbours.

    Args:
        axes: The panel; nothing may stand right of it.
        ends: Of the lines.
        size: Of the words, in points.
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
    """Places as near as can be to those wanted, in the same order, no two nearer than they are high.

    Args:
        at: The places wanted.
        heights: What stands there, centred.
    """
    order = np.argsort(at, kind="stable")
    middles = np.cumsum(heights[order]) - heights[order] / 2
    groups: list[tuple[float, int]] = []  # mean of what is wanted less what is taken below, and members
    for wanted in at[order] - middles:
        groups.append((float(wanted), 1))
        while len(groups) > 1 and groups[-2][0] > groups[-1][0]:
            (low, some), (high, more) = groups.pop(-2), groups.pop()
            groups.append(((low * some + high * more) / (some + more), some + more))
    bottom = np.clip([base for base, _ in groups], *_within(heights.sum()))
    found = np.empty(len(at))
    found[order] = np.repeat(bottom, [count for _, count in groups]) + middles
    return found


def _within(height: float) -> tuple[float, float]:
    """The lowest and the highest place of the bottom of all labels: beside the panel, if there is room."""
    room = max(1 + 2 * _BEYOND - height, 0)
    return -_BEYOND, room - _BEYOND


def _in_panel(axes: Axes, end: LineEnd) -> tuple[float, float]:
    """Shares of the panel's width and height."""
    x, y = axes.transAxes.inverted().transform(axes.transData.transform((end.x, end.y)))
    return float(x), float(y)
