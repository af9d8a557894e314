"""How far in the world: true distances at the end of reaches, which errors in images do not tell."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import pandas as pd

from experiments.config.environment import EnvironmentConfig
from experiments.reporting.pages import SummaryRow, summary_row
from experiments.reporting.tables import Table, percent, written
from experiments.statistics import Estimate, mean_share

FAR_MM = 10
"""A trial that ends farther off is far. Choice: what a gripper that opens by some centimetres forgives."""
HOW_FAR = (
    " How far in the world: the true distance of gripper and object at the end of a trial, whether a "
    "rendezvous was observed or not. Half of the trials end within the median, 95 % within the next number; "
    f"the share that ends more than {FAR_MM} mm off is a mean over worlds with its 95 % interval. A run that "
    "did not finish has none."
)


class Distances(NamedTuple):
    """True distances at the end of trials, in mm.

    Attributes:
        median, most: Within which half, and 95 %, of all trials end: these have no interval.
        far: The share of trials that end more than `FAR_MM` off, mean over worlds.
        worlds: How many.
    """

    median: float
    most: float
    far: Estimate
    worlds: int


def distances(trials: pd.DataFrame) -> Distances:
    """Those of at least one trial, rows of results."""
    found = trials["distance_mm"]
    far = (found > FAR_MM).groupby(trials["world"]).mean().to_numpy(float)
    return Distances(float(found.median()), float(found.quantile(0.95)), mean_share(far), len(far))


def distance_tables(
    name: str,
    env: EnvironmentConfig,
    columns: Sequence[str],
    found: Iterable[tuple[Sequence[str], Distances]],
) -> tuple[Table, ...]:
    """One table of a scenario or sweep where its task is to reach; none of other tasks."""
    if env.task != "reach":
        return ()
    rows = [
        [*names, written(each.median, ".1f"), written(each.most, ".1f"), percent(each.far, 1)]
        for names, each in found
    ]
    columns = [*columns, "median (mm)", "95 % within (mm)", f"above {FAR_MM} mm"]
    return (Table.of(f"{name}-distance", f"{name}, how far in the world", columns, rows),)


def distance_rows(scenario: str, table: str, agent: str, moment: str, found: Distances) -> list[SummaryRow]:
    """Rows of the report's summary; see `summary_row`."""
    measured = (("distance_mm", found.median), ("distance_mm_95", found.most), ("far", found.far))
    return [
        summary_row(scenario, table, agent, moment, measure, each, found.worlds) for measure, each in measured
    ]
