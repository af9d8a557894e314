"""A scenario's part of the report."""

import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    FinishedSuite,
    about,
    with_cost,
    worlds_of,
)
from experiments.reporting.held_out.checkpoints import checkpoint_section
from experiments.reporting.held_out.comparison import comparison_section
from experiments.reporting.held_out.estimates import MOMENTS, Moment, moments
from experiments.reporting.held_out.profile import profile_section
from experiments.reporting.held_out.thresholds import threshold_section
from experiments.reporting.learning_picture import learning_picture
from experiments.reporting.pages import Section, SummaryRow, summary_row
from experiments.reporting.pages.head_table import head_part
from experiments.reporting.pages.style import save
from experiments.reporting.tables import NOTHING, Table, number, percent, with_most
from experiments.statistics import most_worlds

_HOW_TO_READ = (
    "Before: the last held-out trials before the world first changes. Right after: the first ones in the "
    "changed world. Motions per reach: the median world, a trial without a rendezvous counting as the cap; "
    "in brackets the 10th to the 90th percentile of worlds (of fewer than 20 the lowest and the highest). "
    "Rendezvous, the share of trials that end with an observed one, and motions of those trials alone are "
    "two numbers: each has its 95 % interval over worlds, of the mean and of the median. "
    f"{SUCCESS_IN_WORDS} A run that did not finish counts as no success and as the cap."
)


def scenario_sections(finished: FinishedSuite, scenario: ScenarioConfig) -> list[Section]:
    """Learning curves and moments; agents compared; errors at the end; motions to a threshold."""
    rows = with_cost(finished.results, scenario)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents_in(scenario))
    found = {label: moments(rows, label, worlds_of(suite, label), cap) for label in labels}
    sections = [_curves_and_moments(finished, scenario, found)]
    if any(of_agent for of_agent in found.values()):
        sections.append(checkpoint_section(finished, scenario, rows))
        sections.append(threshold_section(finished, scenario, rows))
        sections.append(profile_section(finished, scenario, found))
    if len(labels) > 1:
        sections.append(comparison_section(finished, scenario, found))
    return sections


def _curves_and_moments(
    finished: FinishedSuite, scenario: ScenarioConfig, found: dict[str, dict[str, Moment]]
) -> Section:
    name, figures = f"{scenario.name}-held-out", {}
    if scenario != head_part(finished):  # that one has it above
        figures[name] = save(learning_picture(finished, scenario), finished.out / "figures", name)
    return Section(
        title=f"{scenario.name}: held-out trials",
        text=about(finished, scenario),
        figures=figures,
        tables=(_moments(found, finished, scenario), _intervals(found, scenario)),
        note=_HOW_TO_READ,
        summary=_summary(found, scenario),
    )


def _moments(found: dict[str, dict[str, Moment]], finished: FinishedSuite, scenario: ScenarioConfig) -> Table:
    lines = []
    for label, of_agent in found.items():
        worlds = worlds_of(finished.suite, label)
        if not of_agent:
            lines.append([label, "no run finished", f"0 of {worlds}", NOTHING, NOTHING])
        for name, moment in _in_order(of_agent):
            motions = moment.worlds[MOTIONS].to_numpy()
            shown = with_most(moment.motions().value, most_worlds(motions), ".1f")
            share = f"{moment.share(RENDEZVOUS).value:.0%}".replace("%", " %")
            lines.append([label, name, f"{moment.finished} of {worlds}", shown, share])
    columns = ["agent", "when", "worlds", "motions per reach", "rendezvous"]
    return Table(f"{scenario.name}-moments", scenario.name, pd.DataFrame(lines, columns=columns))


def _intervals(found: dict[str, dict[str, Moment]], scenario: ScenarioConfig) -> Table:
    lines = [
        [
            label,
            name,
            percent(moment.share(RENDEZVOUS)),
            number(moment.among_reached()),
            percent(moment.share(SUCCESS)),
        ]
        for label, of_agent in found.items()
        for name, moment in _in_order(of_agent)
    ]
    columns = ["agent", "when", "rendezvous", "motions of those that reached", "success"]
    title = f"{scenario.name}, with intervals"
    return Table(f"{scenario.name}-intervals", title, pd.DataFrame(lines, columns=columns))


def _summary(found: dict[str, dict[str, Moment]], scenario: ScenarioConfig) -> list[SummaryRow]:
    rows = []
    for label, of_agent in found.items():
        for name, moment in _in_order(of_agent):
            where, worlds = (scenario.name, "held_out", label, name), len(moment.worlds)
            rows += [
                summary_row(*where, SUCCESS, moment.share(SUCCESS), worlds),
                summary_row(*where, RENDEZVOUS, moment.share(RENDEZVOUS), worlds),
                summary_row(*where, MOTIONS, moment.motions(), worlds),
                summary_row(
                    *where,
                    f"{MOTIONS}_among_reached",
                    moment.among_reached(),
                    int(moment.worlds["among_reached"].notna().sum()),
                ),
                summary_row(*where, "distance_mm", moment.distance_mm, moment.finished),
            ]
    return rows


def _in_order(found: dict[str, Moment]) -> list[tuple[str, Moment]]:
    return [(name, found[name]) for name in MOMENTS if name in found]
