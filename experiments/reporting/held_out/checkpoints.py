"""What each agent has come to after how many motions, and how soon it is back after a perturbation."""

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, FinishedSuite, few_worlds
from experiments.reporting.held_out.estimates import held_out_curve
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent
from experiments.statistics import bands, mean

_STEPS = np.array([step * 10**power for power in range(8) for step in (1, 2, 5)])
"""Motions since the beginning, or since a perturbation; the first checkpoint after each is shown."""
_NAMES = {RENDEZVOUS: "rendezvous", SUCCESS: "success", MOTIONS: "motions per reach"}
_FORMS = {RENDEZVOUS: percent, SUCCESS: percent, MOTIONS: lambda found: number(found, 2)}
_HOW_TO_READ = (
    "Held-out trials after so many motions of the lifetime; in brackets, how many of them since the "
    "last perturbation. Rendezvous: the last observation was within the tolerance. Success: the true "
    "error was. Motions per reach: a trial without a rendezvous counts as the cap. Means over worlds "
    "with 95 % intervals over worlds; the upper limit of motions allows for a world, not met, in which "
    "nothing works."
)


def shown_checkpoints(rows: pd.DataFrame) -> dict[float, str]:
    """The checkpoints that all runs have, thinned to a sequence 1-2-5 and the last: their names by motions.

    Args:
        rows: What `with_cost` returned.
    """
    keys = ["agent", "world", "lifetime_motions"]
    held_out = rows[rows["phase"] == "eval"].drop_duplicates(keys)
    since = held_out["motions_since_perturbation"].astype("Float64").to_numpy(dtype=float, na_value=np.nan)
    at = held_out.assign(since=since).groupby("lifetime_motions")["since"]
    found = at.agg(runs="size", since="min", latest="max").reset_index()
    everywhere = found["runs"] == held_out.groupby(["agent", "world"]).ngroups
    found = found[everywhere & ~(found["since"] < found["latest"])]
    clock = found["since"].fillna(found["lifetime_motions"])
    step = pd.Series(np.searchsorted(_STEPS, clock, side="right"), found.index)
    stretch = found["since"].notna(), found["lifetime_motions"] - clock
    first = pd.concat([*stretch, step], axis=1).drop_duplicates().index
    shown = found.loc[sorted({*first, *found.index[-1:]})]
    return {
        row.lifetime_motions: f"{row.lifetime_motions:,}" + (f" (+{row.since:,.0f})" if row.since > 0 else "")
        for row in shown.itertuples()
    }


def checkpoint_section(finished: FinishedSuite, scenario: ScenarioConfig, rows: pd.DataFrame) -> Section:
    """Rendezvous, success and motions per reach of all agents at some checkpoints, as a table."""
    worlds, shown = finished.suite.worlds, shown_checkpoints(rows)
    lines, summary = [], []
    for agent in (agent.label for agent in finished.suite.agents):
        for measure, form in _FORMS.items():
            curve = held_out_curve(rows, agent, measure, worlds, scenario)
            values = curve.runs[:, np.searchsorted(curve.motions, list(shown), side="right") - 1]
            found = bands(values, mean, curve.bounds, np.random.default_rng(0))
            lines.append([agent if measure == RENDEZVOUS else "", _NAMES[measure], *map(form, found)])
            summary += [
                summary_row(scenario.name, "checkpoints", agent, name, measure, each, worlds)
                for name, each in zip(shown.values(), found, strict=True)
            ]
    columns = ["agent", "", *shown.values()]
    return Section(
        title=f"Scenario {scenario.name}, after how many motions",
        text=f"How fast each agent learns, and recovers.{few_worlds(finished.suite)}",
        table=Table("checkpoints", f"{scenario.name}, checkpoints", pd.DataFrame(lines, columns=columns)),
        note=_HOW_TO_READ,
        summary=summary,
    )
