"""Performance profiles: the share of trials that end within so many pixels of the object."""

import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.evaluation import THRESHOLDS_PX
from experiments.reporting.finished_suite import FinishedSuite, few_worlds
from experiments.reporting.held_out.estimates import Moment
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, percent
from experiments.statistics import performance_profile

_HOW_TO_READ = (
    "The share of held-out trials at the end of the lifetimes whose true error, the larger of both "
    "images', ended within so many pixels of 512: mean over worlds, with its 95 % interval over "
    "worlds. Errors count whether a rendezvous was observed or not. A run that did not finish has "
    "none within."
)


def profile_section(
    finished: FinishedSuite, scenario: ScenarioConfig, found: dict[str, dict[str, Moment]]
) -> Section:
    """The profiles of all agents at the end of their lifetimes, as a table.

    Args:
        finished: The suite.
        scenario: What the moments are of.
        found: By the agent's label.
    """
    ends = {agent: of["at the end"] for agent, of in found.items() if "at the end" in of}
    lines, summary = [], []
    for agent, moment in ends.items():
        profile = performance_profile(moment.errors_px, THRESHOLDS_PX)
        lines.append([agent, *map(percent, profile)])
        where = scenario.name, "profile", agent
        summary += [
            summary_row(*where, f"{px} px", "within", share, len(moment.worlds))
            for px, share in zip(THRESHOLDS_PX, profile, strict=True)
        ]
    columns = ["agent", *(f"within {px} px" for px in THRESHOLDS_PX)]
    return Section(
        title=f"{scenario.name}: errors at the end",
        text=f"Performance profiles.{few_worlds(finished, scenario)}",
        tables=(
            Table(
                f"{scenario.name}-profile",
                f"{scenario.name}, errors at the end",
                pd.DataFrame(lines, columns=columns),
            ),
        ),
        note=_HOW_TO_READ,
        summary=summary,
    )
