"""What a table has learned, as a picture: its cells as they lie in the two images."""

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from agents.knowledge.grid_table import GridTable
from calfree_gym.files import check_size
from experiments.errors import ConfigError
from experiments.reporting.figures import STYLE

_IMAGES = (("left image", "$x_a$", "$y_a$"), ("right image", "$x_b$", "$y_b$"))
_EMPTY = "#f2f2f2"
_SHADES = "Blues"
_LIGHTEST, _DARKEST = 0.15, 0.85
"""Part of the shades that is used: none trusted is no white, and all trusted no black."""


def draw_table(source: Path, out: Path) -> None:
    """Draws the table of a saved `grid_table` to the image file `out`."""
    figure = table_figure(load_table(source))
    try:
        figure.savefig(out, dpi=150)
    except ValueError as error:
        raise ConfigError(f"{out}: {error}") from None
    finally:
        plt.close(figure)


def load_table(source: Path) -> GridTable:
    """The table of a saved `grid_table`."""
    try:
        with np.load(source, allow_pickle=False) as file:
            check_size(file.zip)
            arrays = {name: file[name] for name in file.files}
        kind = json.loads(str(arrays["calfree.json"]))["kind"]
    except FileNotFoundError:
        raise ConfigError(f"{source}: there is no such file") from None
    except Exception:  # what NumPy raises on a damaged file depends on where the damage is
        raise ConfigError(
            f"{source} is damaged or no saved agent; allowed: a file that grid_table.save wrote"
        ) from None
    if not kind.startswith("GridTable("):
        raise ConfigError(f"{source} holds {kind}; only a saved grid_table can be drawn")
    try:
        corners, motors = arrays["records"].shape
        table = GridTable(motors, cells=round(corners**0.25) - 1)
        table.restore(arrays)
    except (KeyError, ValueError) as error:
        raise ConfigError(f"{source} is damaged: {error}") from None
    return table


def table_figure(table: GridTable) -> Figure:
    """Both images side by side, with the table's cells as seen in them.

    A place in an image belongs to many cells, which differ in where they lie in the other one. The number
    says how many of them are filled; the darker, the more of these are trusted.
    """
    filled, trusted = table.known_cells()
    with plt.rc_context({**STYLE, "axes.grid": False, "axes.titlepad": 8}):
        figure = plt.figure(figsize=(9.6, 5.4), layout="constrained")
        panels = figure.subplots(1, 2)
        for panel, other, (title, x, y) in zip(panels, ((2, 3), (0, 1)), _IMAGES, strict=True):
            shades = _image(panel, filled.sum(other), trusted.sum(other))
            panel.set(title=title, xlabel=x, ylabel=y)
        bar = figure.colorbar(shades, ax=panels, shrink=0.8, label="of the filled cells, trusted")
        bar.ax.yaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f} %")
        bar.outline.set_visible(False)
        trusted_means = f"all corners corrected by {table.TRUSTED} successes or more"
        figure.legend(
            handles=[
                Patch(color=_EMPTY, label="no cell is filled"),
                Patch(
                    color=plt.get_cmap(_SHADES)(_LIGHTEST), label="filled, none trusted; number: filled cells"
                ),
                Patch(color=plt.get_cmap(_SHADES)(_DARKEST), label=f"trusted: {trusted_means}"),
            ],
            loc="outside lower center",
            ncols=3,
        )
        figure.suptitle(
            "“It is obvious what has been learned.” (Graefe 1999, section 4.3)\n"
            f"{filled.sum():,} of {filled.size:,} cells are filled, {trusted.sum():,} are trusted",
            fontsize=11,
        )
    return figure


def _image(panel: Axes, filled: NDArray[np.int64], trusted: NDArray[np.int64]) -> Any:
    """Draws counts (cells, cells) of x by y as an image, with y downward."""
    cells = len(filled)
    share = np.ma.masked_array(trusted / np.maximum(filled, 1), mask=filled == 0)
    shades = plt.get_cmap(_SHADES)
    colours = shades(np.linspace(_LIGHTEST, _DARKEST, 256))
    panel.set_facecolor(_EMPTY)
    drawn = panel.imshow(share.T, cmap=ListedColormap(colours), vmin=0, vmax=1, extent=(-1, 1, 1, -1))
    for x, y in np.argwhere(filled):
        panel.text(
            (x + 0.5) * 2 / cells - 1,
            (y + 0.5) * 2 / cells - 1,
            str(filled[x, y]),
            ha="center",
            va="center",
            fontsize=min(8, 72 / cells),
            color="white" if share[x, y] > 0.55 else "#20304a",
        )
    edges = np.linspace(-1, 1, cells + 1)
    panel.set_xticks(edges, minor=True)
    panel.set_yticks(edges, minor=True)
    panel.grid(which="minor", color="white", linewidth=1.2)
    panel.tick_params(which="both", length=0)
    panel.set_xticks([-1, 0, 1])
    panel.set_yticks([-1, 0, 1])
    panel.spines[:].set_visible(False)
    return drawn
