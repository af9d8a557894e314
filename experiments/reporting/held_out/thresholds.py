"""After how many motions an agent is good."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import RENDEZVOUS, FinishedSuite, few_worlds, worlds_of
from experiments.reporting.held_out.clocks import with_clocks
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import NOTHING, Table, number
from experiments.statistics import Array, median_time

GOOD = 0.95
"""Share of a checkpoint's trials with an observed rendezvous."""
BEGINNING, AFTER = _STRETCHES = ("from the beginning", "after the first change")
_HOW_TO_READ = (
    f"Motions lived until the first checkpoint at which {GOOD:.0%} of the held-out trials end with an "
    "observed rendezvous, as they do on average from there to the next change or the end (a lucky "
    "checkpoint does not count). Times are those of checkpoints: no finer than their distance. Median: "
    "over worlds, by Kaplan and Meier, since a life may end before; ∞ where half of the worlds do not "
    "come to it. Brackets: 95 % intervals."
).replace("%", " %", 1)

Times = tuple[Array, NDArray[np.bool_], float]


def times_to_good(rows: pd.DataFrame, agent: str, worlds: int) -> dict[str, Times]:
    """When each world's run was first good, or was last looked at, and whether it was good.

    Args:
        rows: What `with_cost` returned.
        agent: The agent's label.
        worlds: How many runs there should be; those without any row were never good.

    Returns:
        By the stretch of the lifetime: both of shape (worlds,), and the latest time that was looked at;
        a stretch that no run came to is left out.
    """
    mine = with_clocks(rows[rows["agent"] == agent])
    failed = worlds - mine["world"].nunique()
    return {
        name: _first_good(of_stretch, failed)
        for stretch, name in enumerate(_STRETCHES)
        if len(of_stretch := mine[mine["stretch"] == stretch])
    }


def _first_good(rows: pd.DataFrame, failed: int) -> Times:
    shares = rows.groupby(["world", "clock"])[RENDEZVOUS].mean().reset_index()
    backwards = shares.sort_values("clock", ascending=False)
    shares["later"] = backwards.groupby("world")[RENDEZVOUS].transform(lambda own: own.expanding().mean())
    lasting = shares[(shares[RENDEZVOUS] >= GOOD) & (shares["later"] >= GOOD)]
    good = lasting.groupby("world")["clock"].min()
    last = shares.groupby("world")["clock"].max()
    times = good.reindex(last.index).fillna(last).to_numpy(dtype=float)
    reached = last.index.isin(good.index)
    latest = float(last.max())
    return np.append(times, [latest] * failed), np.append(reached, [False] * failed), latest


def threshold_section(finished: FinishedSuite, scenario: ScenarioConfig, rows: pd.DataFrame) -> Section:
    """Motions to the threshold, from the beginning and after the first change."""
    lines, summary = [], []
    for label in (agent.label for agent in finished.suite.agents_in(scenario)):
        times = times_to_good(rows, label, worlds_of(finished.suite, label))
        cells = []
        for name in _STRETCHES:
            if name not in times:
                cells += [NOTHING, NOTHING]
                continue
            at, good, _ = times[name]
            median = median_time(at, good)
            cells += [f"{int(good.sum())} of {len(good)}", number(median, 0)]
            summary.append(summary_row(scenario.name, "threshold", label, name, "median", median, len(good)))
        lines.append([label, *cells])
    threshold = f"{GOOD:.0%}".replace("%", " %")
    columns = ["agent", *(f"{what}, {name}" for name in _STRETCHES for what in ("worlds", "median"))]
    title = f"{scenario.name}, motions lived until {threshold} rendezvous"
    return Section(
        title=f"{scenario.name}: motions lived until {threshold} rendezvous",
        text=f"How soon each agent is good.{few_worlds(finished, scenario)}",
        tables=(Table(f"{scenario.name}-threshold", title, pd.DataFrame(lines, columns=columns)),),
        note=_HOW_TO_READ,
        summary=summary,
    )
