"""What each agent has come to after how many motions, and how soon it is back after a perturbation."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, FinishedSuite, few_worlds
from experiments.reporting.held_out.estimates import worst_and_bounds
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent
from experiments.statistics import Estimate, mean, over_worlds

_STEPS = np.array([step * 10**power for power in range(8) for step in (1, 2, 5)])
"""Motions since the beginning, or since a perturbation; the first checkpoint after each is shown."""
_CHANGES = 3
"""Perturbations after which checkpoints are shown: a table has an end."""
_FORMS: dict[str, tuple[str, Callable[[Estimate], str]]] = {
    RENDEZVOUS: ("rendezvous", percent),
    SUCCESS: ("success", percent),
    MOTIONS: ("motions per reach", lambda found: number(found, 2)),
}
_HOW_TO_READ = (
    "Held-out trials after so many motions, since the beginning or since a perturbation. Where an agent "
    "has no checkpoint there, its next one, or else its last. Rendezvous: the last observation was within "
    "the tolerance. Success: the true error was. Motions per reach: a trial without a rendezvous counts as "
    "the cap. Means over worlds with 95 % intervals over worlds; the upper limit of motions allows for a "
    "world, not met, in which nothing works."
)
Checkpoint = tuple[int, float]
"""How many times the world had changed before it, and motions since the last time, or since the beginning."""


def with_clocks(rows: pd.DataFrame) -> pd.DataFrame:
    """Held-out trials, each with the `stretch` and the `clock` of its checkpoint.

    The agents' own trials tell of changes, too, after which nothing was held out.

    Args:
        rows: What `with_cost` returned.
    """
    since = pd.Series(
        rows["motions_since_perturbation"].astype("Float64").to_numpy(float, na_value=np.nan), rows.index
    )
    changed_at = rows["lifetime_motions"] - since
    stretch = changed_at.groupby([rows["agent"], rows["world"]]).rank("dense").fillna(0).astype(int)
    clocked = rows.assign(stretch=stretch, clock=since.fillna(rows["lifetime_motions"]))
    return clocked[clocked["phase"] == "eval"]


def shown_checkpoints(held_out: pd.DataFrame) -> dict[Checkpoint, str]:
    """Checkpoints to show, and their names: in each stretch those of the run with most, thinned to 1-2-5.

    Args:
        held_out: What `with_clocks` returned.
    """
    shown: dict[Checkpoint, str] = {}
    for stretch, found in held_out[held_out["stretch"] <= _CHANGES].groupby("stretch"):
        runs = found.groupby(["agent", "world"], sort=False)["clock"].unique()
        clocks = np.sort(max(runs, key=len))
        _, first = np.unique(np.searchsorted(_STEPS, clocks, side="right"), return_index=True)
        for i in sorted({*first.tolist(), len(clocks) - 1}):
            after = f" after change {stretch}" if stretch else ""
            shown[stretch, clocks[i]] = f"{'+' if stretch else ''}{clocks[i]:,.0f}{after}"
    return shown


def scores(own: pd.DataFrame, measure: str, at: Checkpoint) -> pd.Series:
    """Each world's mean over its trials at a checkpoint, or at the next, or else at its last.

    Worlds that have none since so many perturbations lack.

    Args:
        own: Of one agent, what `with_clocks` returned.
        measure: A column.
        at: The checkpoint.
    """
    stretch, clock = at
    found = own[own["stretch"] == stretch].groupby(["world", "clock"])[measure].mean().reset_index()
    due = found[found["clock"] >= clock].groupby("world").first()
    last = found.groupby("world").last()
    return due[measure].combine_first(last[measure])


def checkpoint_section(finished: FinishedSuite, scenario: ScenarioConfig, rows: pd.DataFrame) -> Section:
    """Rendezvous, success and motions per reach of all agents at some checkpoints, as a table."""
    worlds, held_out = finished.suite.worlds, with_clocks(rows)
    shown = shown_checkpoints(held_out)
    lines, summary = [], []
    for agent in (agent.label for agent in finished.suite.agents_in(scenario)):
        own = held_out[held_out["agent"] == agent]
        failed = worlds - rows.loc[rows["agent"] == agent, "world"].nunique()
        for measure, (name, form) in _FORMS.items():
            worst, bounds = worst_and_bounds(measure, scenario)
            cells = []
            for at, when in shown.items():
                values = np.append(scores(own, measure, at).to_numpy(float), [worst] * failed)
                if not len(values):
                    cells.append("–")
                    continue
                estimate = over_worlds(values, mean, bounds, np.random.default_rng(0))
                cells.append(form(estimate))
                summary.append(
                    summary_row(scenario.name, "checkpoints", agent, when, measure, estimate, len(values))
                )
            lines.append([agent if measure == RENDEZVOUS else "", name, *cells])
    columns = ["agent", "", *shown.values()]
    return Section(
        title=f"Scenario {scenario.name}, after how many motions",
        text=f"How fast each agent learns, and recovers.{few_worlds(finished.suite)}",
        table=Table("checkpoints", f"{scenario.name}, checkpoints", pd.DataFrame(lines, columns=columns)),
        note=_HOW_TO_READ,
        summary=summary,
    )
