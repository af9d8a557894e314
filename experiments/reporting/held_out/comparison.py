"""Each agent beside the first one of the suite, in the same worlds and trials."""

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, FinishedSuite, few_worlds
from experiments.reporting.held_out.estimates import Moment
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent
from experiments.statistics import (
    Estimate,
    median,
    over_worlds,
    paired_difference,
    paired_shares,
    probability_of_improvement_paired,
)

_FORMS = {
    SUCCESS: percent,
    RENDEZVOUS: percent,
    MOTIONS: number,
    f"{MOTIONS}_median": number,
    "fewer_motions": percent,
}
_HOW_TO_READ = (
    "What an agent has more of than the first one, in the same worlds with the same held-out trials, "
    "all agents by what they came to at that moment of their own lifetimes. Success, rendezvous: "
    "means over worlds, in points of a percentage. Motions per reach (a failure counts as the cap): "
    "mean over worlds with a paired t interval, and median over worlds. Fewer motions: the share of "
    "worlds in which it needs fewer, equal ones counting half. Intervals: 95 % over worlds; that of the "
    "mean motions knows of no world that is bad for one agent alone and was not met: with 4 worlds it "
    "then holds the truth in 37 %, with 20 in 90 % (`benchmark coverage`); the median and the share do not "
    "depend on it."
)


def differences(mine: Moment, reference: Moment) -> dict[str, Estimate]:
    """What an agent has more of than a reference, world by world, by the name of the measure.

    Args:
        mine: The agent's.
        reference: The other's; only worlds in which both came to their moments are compared.
    """
    both = common_worlds(mine, reference)
    own, other = mine.worlds.loc[both], reference.worlds.loc[both]
    motions, others_motions = own[MOTIONS].to_numpy(), other[MOTIONS].to_numpy()
    bounds = (-float(mine.cap), float(mine.cap))
    return {
        **{
            share: paired_shares(own[share].to_numpy(), other[share].to_numpy(), np.random.default_rng(0))
            for share in (SUCCESS, RENDEZVOUS)
        },
        MOTIONS: paired_difference(motions, others_motions),
        f"{MOTIONS}_median": over_worlds(motions - others_motions, median, bounds, np.random.default_rng(0)),
        "fewer_motions": probability_of_improvement_paired(
            -motions, -others_motions, np.random.default_rng(0)
        ),
    }


def common_worlds(mine: Moment, reference: Moment) -> "pd.Index[int]":
    """The worlds in which both came to their moments."""
    return mine.worlds.index.intersection(reference.worlds.index)


def comparison_section(
    finished: FinishedSuite, scenario: ScenarioConfig, found: dict[str, dict[str, Moment]]
) -> Section:
    """All agents but the first one, at each moment to which both came."""
    first, *others = found
    lines, summary = [], []
    for agent in others:
        for name in (name for name in found[agent] if name in found[first]):
            mine, reference = found[agent][name], found[first][name]
            if not (both := len(common_worlds(mine, reference))):
                continue
            of = differences(mine, reference)
            lines.append([agent, name, *(_FORMS[measure](each) for measure, each in of.items())])
            where = scenario.name, "comparison", agent, name
            summary += [summary_row(*where, key, each, both) for key, each in of.items()]
    columns = ["agent", "when", "success", "rendezvous", "motions per reach", "median", "fewer motions"]
    title = f"{scenario.name}, beside {first}"
    return Section(
        title=f"Scenario {scenario.name}, beside {first}",
        text=f"Paired differences from {first}.{few_worlds(finished.suite)}",
        table=Table("comparison", title, pd.DataFrame(lines, columns=columns)),
        note=_HOW_TO_READ,
        summary=summary,
    )
