"""How fast it is, as a user feels it: motions, worlds, pictures, decisions, and training beside others."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from itertools import chain
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from experiments.reporting.figures import STYLE, LineEnd, label_lines, say
from experiments.reporting.tables import Table
from experiments.studies.speed.motions import Line, by_rows, ratios, written
from experiments.studies.speed.peers import Peer, beside
from experiments.studies.speed.waits import lines

ROUNDS = 60
PACKAGES = "mujoco", "gymnasium", "numpy", "stable-baselines3", "torch"
_COLOURS = {"kinematic": "#003F8F", "physics": "#B84300"}


def tables(peers: Sequence[str] = (), rounds: int = ROUNDS) -> Iterator[Table]:
    """What takes how long; and motions a second, by how many arms move at once.

    Pairs are timed so many times, of what is slow fewer.
    """
    machine: dict[str, Any] = {"cores": os.cpu_count(), "python": platform.python_version()}
    machine |= {name: version(name) for name in PACKAGES}
    with ExitStack() as stack:
        others = [stack.enter_context(Peer(spec)) for spec in peers]
        found = [*ratios(rounds), *lines(rounds)]
        found += chain.from_iterable(beside(peer, max(rounds // 3, 1)) for peer in others)
        for peer in others:
            machine[peer.env_id] = " ".join(f"{name} {of}" for name, of in peer.versions.items())
    told = ", ".join(f"{name} {of}" for name, of in machine.items())
    yield _table(found, f"Medians over rounds; ratios are medians of pairs that were timed in turns. {told}")
    frame = by_rows(max(rounds // 6, 1))
    formats = dict.fromkeys(frame.columns, ",.0f")
    yield Table("rows", "Motions a second", frame, formats, f"All rows together, truth=False. {told}")


def _table(found: Sequence[Line], note: str) -> Table:
    columns = ["ours / beside it", "ours", "beside it", "times as fast", "required"]
    rows = [(line.what, written(line.seconds), written(line.beside), *line[3:]) for line in found]
    formats = {"times as fast": ".3g", "required": ".2g"}
    return Table("speed", "What takes how long", pd.DataFrame(rows, columns=columns), formats, note)


def figure(found: Sequence[Table]) -> Figure:
    """Motions a second against rows."""
    frame = next(table.frame for table in found if table.name == "rows")
    rows = frame["rows"].astype(float)
    with plt.rc_context(STYLE):
        drawn, axes = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
        axes.set(xscale="log", yscale="log", xlabel="arms that move at once (num_envs)")
        axes.set_xlim(rows.min(), rows.max())
        ends = []
        for name in frame.columns.drop("rows"):
            speeds, colour = frame[name].astype(float), _COLOURS[name.split(",")[0]]
            axes.plot(rows, speeds, color=colour, linestyle="-" if "1 thread" in name else "--", marker="o")
            ends.append(LineEnd(rows.iloc[-1], speeds.iloc[-1], name, colour))
        say(drawn, "Motions a second, all arms together", "The nominal world, points, truth=False.")
        label_lines(axes, ends, 10)
    return drawn
