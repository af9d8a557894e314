"""After how many motions an agent is good, and how good it stays: thresholds and last checkpoints."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, FinishedSuite, few_worlds
from experiments.reporting.held_out.checkpoints import with_clocks
from experiments.reporting.held_out.estimates import LAST, last_checkpoints
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent
from experiments.statistics import Array, Estimate, median_time, restricted_mean_time

GOOD = 0.95
"""Share of a checkpoint's trials with an observed rendezvous."""
_STRETCHES = ("from the beginning", "after the first perturbation")
_HOW_TO_READ = (
    f"Motions until the first checkpoint at which {GOOD:.0%} of the held-out trials end with an "
    "observed rendezvous, as they do on average from there to the end of the stretch (an agent that "
    "jumps has lucky checkpoints, which do not count). Times are those of checkpoints: no finer than "
    "their distance. From the beginning of the lifetime, and from the first perturbation. A "
    "world whose lifetime, or the time until its next perturbation, ends before that is "
    "right-censored. Median: by Kaplan and Meier, ∞ where more than half of the worlds do not come to "
    "it. Restricted mean: a world counts at most as the longest time that was looked at, of any agent. Last "
    f"checkpoints: each world's median over its last {LAST}, then the median over worlds: an agent "
    "that jumps from one checkpoint to the next is not judged by a single one. 95 % intervals over "
    "worlds."
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
    """Motions to the threshold, and medians over the last checkpoints."""
    worlds = finished.suite.worlds
    lines, summary = [], []
    labels = [agent.label for agent in finished.suite.agents_in(scenario)]
    found_times = {label: times_to_good(rows, label, worlds) for label in labels}
    horizons = {
        name: max(of[name][2] for of in found_times.values() if name in of)
        for name in _STRETCHES
        if any(name in of for of in found_times.values())
    }
    for agent in labels:
        found: dict[str, Estimate] = {}
        cells = []
        times = found_times[agent]
        for name in _STRETCHES:
            if name not in times:
                cells += ["–", "–", "–"]
                continue
            at, good, _ = times[name]
            middle = median_time(at, good, np.random.default_rng(0))
            mean = restricted_mean_time(at, good, horizons[name], np.random.default_rng(0))
            found |= {f"median {name}": middle, f"restricted mean {name}": mean}
            cells += [f"{int(good.sum())} of {len(good)}", _motions(middle), _motions(mean)]
        for measure, form in ((SUCCESS, percent), (RENDEZVOUS, percent), (MOTIONS, number)):
            last = last_checkpoints(rows, agent, measure, worlds, scenario)
            found[f"{measure} of the last checkpoints"] = last
            cells.append(form(last))
        lines.append([agent, *cells])
        where = scenario.name, "threshold", agent, "lifetime"
        summary += [summary_row(*where, measure, each, worlds) for measure, each in found.items()]
    threshold = f"{GOOD:.0%}".replace("%", " %")
    heads = (f"worlds at {threshold}", "median", "restricted mean")
    columns = [
        "agent",
        *(f"{what}, {name}" for name in _STRETCHES for what in heads),
        *(f"{what}, last checkpoints" for what in ("success", "rendezvous", "motions per reach")),
    ]
    return Section(
        title=f"Scenario {scenario.name}, motions to {threshold} rendezvous",
        text=f"How soon each agent is good, and whether it stays so.{few_worlds(finished.suite)}",
        table=Table("threshold", f"{scenario.name}, threshold", pd.DataFrame(lines, columns=columns)),
        note=_HOW_TO_READ,
        summary=summary,
    )


def _motions(found: Estimate) -> str:
    value, low, high = (
        "∞" if math.isinf(part) else f"{part:,.0f}" for part in (found.value, found.low, found.high)
    )
    return f"{value} [{low}, {high}]"
