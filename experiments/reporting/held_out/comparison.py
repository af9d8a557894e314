"""Each agent beside the first one of the suite, in the same worlds and trials."""

import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, FinishedSuite, few_worlds
from experiments.reporting.held_out.estimates import Moment
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent
from experiments.statistics import Estimate, paired_motions, paired_shares, share_of_worlds

_FORMS = {RENDEZVOUS: percent, MOTIONS: number, "fewer_motions": percent}
_HOW_TO_READ = (
    "What an agent has more of than the first one, in the worlds in which both are, each at that moment "
    "of its own life. Rendezvous: the mean over worlds, in points of a percentage. Motions per reach (a "
    "failure counts as the cap): the median over worlds of the difference. Fewer motions: the share of "
    "worlds in which it needs fewer, equal ones counting half. Brackets: 95 % intervals over worlds."
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
    return {
        RENDEZVOUS: paired_shares(own[RENDEZVOUS].to_numpy(), other[RENDEZVOUS].to_numpy()),
        MOTIONS: paired_motions(motions, others_motions),
        "fewer_motions": share_of_worlds(motions, others_motions),
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
    columns = ["agent", "when", "rendezvous", "motions per reach", "fewer motions"]
    title = f"{scenario.name}, beside {first}"
    table = Table(f"{scenario.name}-comparison", title, pd.DataFrame(lines, columns=columns))
    return Section(
        title=f"{scenario.name}: beside {first}",
        text=f"Differences from {first} in the same worlds.{few_worlds(finished, scenario)}",
        tables=(table,),
        note=_HOW_TO_READ,
        summary=summary,
    )
