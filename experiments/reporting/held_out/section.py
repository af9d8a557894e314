"""A scenario's part of the report."""

import pandas as pd

from experiments.config.suite import EvaluationConfig, ScenarioConfig
from experiments.reporting.finished_suite import (
    MOTIONS,
    SUCCESS,
    FinishedSuite,
    about,
    perturbations_met,
    with_cost,
)
from experiments.reporting.held_out.estimates import Moment, held_out_curve, moments, training_curve
from experiments.reporting.held_out.figure import learning_curves
from experiments.reporting.pages import Section, SummaryRow, summary_row
from experiments.reporting.style import save
from experiments.reporting.tables import Table, number, percent

_MOMENTS = ("before", "right after", "at the end")

_HOW_TO_READ = (
    "Before: the last held-out trials before a run's first perturbation. Right after: the first ones in "
    "the perturbed world. Worlds: runs that finished and came to that moment; lifetime motions: the "
    "fewest and the most among them. Success: all their trials, with the 95 % Wilson interval of trials "
    "in these very worlds. Motions per reach: each world's mean, a failed trial counting as the cap; "
    "interquartile mean over worlds, with a 95 % bootstrap over worlds. Distance: median true distance "
    "at the end of a trial. A run that did not finish counts as no success and as the cap; it has no "
    "distance."
)


def scenario_section(
    finished: FinishedSuite, scenario: ScenarioConfig, evaluation: EvaluationConfig
) -> Section:
    """The learning curves of one scenario, and the table of their moments."""
    rows = with_cost(finished.results, scenario)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents)
    width = max(evaluation.every, 2 * cap)
    perturbations = perturbations_met(finished, scenario, "motions")
    held_out = learning_curves(
        f"{scenario.name}: held-out trials, {evaluation.trials} at each checkpoint",
        lambda agent, measure: held_out_curve(rows, agent, measure, suite.worlds, scenario),
        labels,
        cap,
        perturbations,
    )
    training = learning_curves(
        f"{scenario.name}: the agents' own trials, mean of each {width:,} motions",
        lambda agent, measure: training_curve(rows, agent, measure, suite.worlds, scenario, width),
        labels,
        cap,
        perturbations,
    )
    folder = finished.out / "figures"
    found = {label: moments(rows, label, suite.worlds, cap) for label in labels}
    return Section(
        title=f"Scenario {scenario.name}",
        text=about(suite, scenario),
        figures={
            f"{scenario.name}-{what}": save(figure, folder, f"{scenario.name}-{what}")
            for what, figure in (("held-out", held_out), ("training", training))
        },
        table=_table(found, scenario, suite.worlds),
        note=_HOW_TO_READ,
        summary=_summary(found, scenario, suite.worlds),
    )


def _table(found: dict[str, dict[str, Moment]], scenario: ScenarioConfig, worlds: int) -> Table:
    rows = []
    for agent, of_agent in found.items():
        if not of_agent:
            cap = f"{scenario.env.max_episode_steps}"
            rows.append([agent, "no run finished", f"0 of {worlds}", "–", "0 %", cap, "–"])
        for name, moment in _in_order(of_agent):
            rows.append(
                [
                    agent,
                    name,
                    f"{moment.worlds} of {worlds}",
                    _range(*moment.lifetime_motions),
                    percent(moment.success),
                    number(moment.motions_per_reach),
                    f"{moment.distance_mm:.1f}",
                ]
            )
    columns = ["agent", "when", "worlds", "lifetime motions", "success", "motions per reach", "distance (mm)"]
    return Table("held_out", scenario.name, pd.DataFrame(rows, columns=columns))


def _summary(found: dict[str, dict[str, Moment]], scenario: ScenarioConfig, worlds: int) -> list[SummaryRow]:
    rows = []
    for agent, of_agent in found.items():
        for name, moment in _in_order(of_agent):
            where = scenario.name, "held_out", agent, name
            rows += [
                summary_row(*where, SUCCESS, moment.success, moment.trials),
                summary_row(*where, MOTIONS, moment.motions_per_reach, worlds),
                summary_row(*where, "distance_mm", moment.distance_mm, moment.worlds),
            ]
    return rows


def _in_order(found: dict[str, Moment]) -> list[tuple[str, Moment]]:
    return [(name, found[name]) for name in _MOMENTS if name in found]


def _range(low: int, high: int) -> str:
    return f"{low:,}" if low == high else f"{low:,} – {high:,}"
