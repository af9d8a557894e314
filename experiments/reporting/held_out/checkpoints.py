"""What each agent has come to after how many motions, and how soon it is back after a change."""

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, FinishedSuite, few_worlds, worlds_of
from experiments.reporting.held_out.clocks import with_clocks
from experiments.reporting.held_out.estimates import worst_and_bounds
from experiments.reporting.pages import Section, SummaryRow, summary_row
from experiments.reporting.pages.narrow import MOST_COLUMNS
from experiments.reporting.tables import NOTHING, Table, with_most
from experiments.statistics import median_world, most_worlds

__all__ = ["checkpoint_section", "with_clocks"]

_CHANGES = 3
"""Changes after which checkpoints are shown: a report has an end."""
_HOW_TO_READ = (
    "Motions per reach in held-out trials, a trial without a rendezvous counting as the cap: the median "
    "world, and in brackets the 10th to the 90th percentile of worlds (of fewer than 20 the lowest and "
    "the highest). Where an agent has no checkpoint after exactly so many motions, its next one."
)


def checkpoint_section(finished: FinishedSuite, scenario: ScenarioConfig, rows: pd.DataFrame) -> Section:
    """Motions per reach of all agents, in a table from the beginning and one after each change."""
    held_out = with_clocks(rows)
    tables, summary = [], []
    for stretch, of_stretch in held_out[held_out["stretch"] <= _CHANGES].groupby("stretch"):
        after = f"after change {stretch}" if stretch else "from the beginning"
        clocks = shown_clocks(of_stretch["clock"].to_numpy(float))
        columns = ["agent", *(f"{'+' if stretch else ''}{clock:,.0f} motions" for clock in clocks)]
        lines = []
        for label in (agent.label for agent in finished.suite.agents_in(scenario)):
            failed = worlds_of(finished.suite, label) - rows.loc[rows["agent"] == label, "world"].nunique()
            own = of_stretch[of_stretch["agent"] == label]
            found = [_shown(scores(own, MOTIONS, clock), failed, scenario) for clock in clocks]
            lines.append([label, *(cell for cell, _ in found)])
            summary += [
                _row(scenario.name, label, f"{clock:,.0f} {after}", values)
                for clock, (_, values) in zip(clocks, found, strict=True)
                if len(values)
            ]
        title = f"{scenario.name}, motions per reach {after}"
        tables.append(Table(f"{scenario.name}-checkpoints", title, pd.DataFrame(lines, columns=columns)))
    return Section(
        title=f"{scenario.name}: after how many motions",
        text=f"How fast each agent learns, and recovers.{few_worlds(finished, scenario)}",
        tables=tuple(tables),
        note=_HOW_TO_READ,
        summary=summary,
    )


def shown_clocks(clocks: np.ndarray) -> list[float]:
    """Checkpoints that a table has room for, of all: the first, the last, and between them by ratios."""
    found = np.unique(clocks)
    wanted = np.geomspace(max(found[0], 1), max(found[-1], 1), MOST_COLUMNS - 1)
    wanted[0] = found[0]
    nearest = [found[np.abs(np.log(found + 1) - np.log(each + 1)).argmin()] for each in wanted]
    return list(dict.fromkeys(nearest))


def scores(own: pd.DataFrame, measure: str, clock: float) -> "pd.Series[float]":
    """Each world's mean over its trials at a checkpoint, or at its next; worlds that have neither lack.

    Args:
        own: Of one agent in one stretch, what `with_clocks` returned.
        measure: A column.
        clock: Motions since the stretch began.
    """
    found = own.groupby(["world", "clock"])[measure].mean().reset_index()
    return found[found["clock"] >= clock].groupby("world")[measure].first()


def _shown(own: "pd.Series[float]", failed: int, scenario: ScenarioConfig) -> tuple[str, np.ndarray]:
    worst, _ = worst_and_bounds(MOTIONS, scenario)
    values = np.append(own.to_numpy(float), [worst] * failed)
    if not len(values):
        return NOTHING, values
    return with_most(float(np.median(values)), most_worlds(values), ".1f"), values


def _row(scenario: str, label: str, when: str, values: np.ndarray) -> SummaryRow:
    return summary_row(scenario, "checkpoints", label, when, MOTIONS, median_world(values), len(values))
