"""A scenario's part of the report."""

import pandas as pd

from experiments.config.evaluation import EvaluationConfig
from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    FinishedSuite,
    about,
    perturbations_met,
    places,
    where_it_stands,
    with_cost,
)
from experiments.reporting.held_out.checkpoints import checkpoint_section
from experiments.reporting.held_out.comparison import comparison_section
from experiments.reporting.held_out.estimates import Moment, held_out_curve, moments, training_curve
from experiments.reporting.held_out.figure import learning_curves
from experiments.reporting.held_out.profile import profile_section
from experiments.reporting.held_out.thresholds import threshold_section
from experiments.reporting.pages import Section, SummaryRow, summary_row
from experiments.reporting.pages.headline import in_words
from experiments.reporting.pages.style import save
from experiments.reporting.tables import Table, number, percent

MOMENTS = ("before", "right after", "at the end")
"""Of a lifetime, in which the world is perturbed."""

_HOW_TO_READ = (
    "Before: the last held-out trials before a run's first perturbation. Right after: the first ones "
    "in the perturbed world. Worlds: runs that finished and came to that moment; lifetime motions: "
    "the fewest and the most among them. "
    f"{SUCCESS_IN_WORDS} Rendezvous: the last observation was. "
    "Motions per reach: a trial without a rendezvous counts as the cap; "
    "then the interquartile mean over worlds, the mean of the worst tenth of those met, and "
    "the mean over trials with a rendezvous alone. All are means over worlds of each world's mean, "
    "but where said, with 95 % intervals over worlds. Distance: median true distance at the end of a "
    "trial. A run that did not finish counts as no success and as the cap; it has no distance."
)


def scenario_sections(
    finished: FinishedSuite, scenario: ScenarioConfig, evaluation: EvaluationConfig
) -> list[Section]:
    """Learning curves and moments; agents compared; errors at the end; motions to a threshold."""
    rows = with_cost(finished.results, scenario)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents_in(scenario))
    found = {label: moments(rows, label, suite.worlds, cap) for label in labels}
    sections = [_curves_and_moments(finished, scenario, evaluation, rows, found)]
    if any("at the end" in of_agent for of_agent in found.values()):
        sections.append(checkpoint_section(finished, scenario, rows))
        trials = f"{evaluation.trials} held-out trials at the end of each lifetime"
        sections.append(
            profile_section(finished, scenario, found, where_it_stands(finished, scenario, trials))
        )
        sections.append(threshold_section(finished, scenario, rows))
    if len(labels) > 1:
        sections.append(comparison_section(finished, scenario, found))
    return sections


def _curves_and_moments(
    finished: FinishedSuite,
    scenario: ScenarioConfig,
    evaluation: EvaluationConfig,
    rows: pd.DataFrame,
    found: dict[str, dict[str, Moment]],
) -> Section:
    suite, cap = finished.suite, scenario.env.max_episode_steps
    width = max(evaluation.every or 0, 2 * cap)
    perturbations = perturbations_met(finished, scenario, "motions")
    held_out = learning_curves(
        f"{scenario.name}: held-out trials, {evaluation.trials} at each checkpoint",
        lambda agent, measure: held_out_curve(rows, agent, measure, suite.worlds, scenario),
        places(suite, scenario),
        cap,
        perturbations,
        where_it_stands(finished, scenario, f"{evaluation.trials} held-out trials at each checkpoint"),
    )
    training = learning_curves(
        f"{scenario.name}: the agents' own trials, mean of each {width:,} motions",
        lambda agent, measure: training_curve(rows, agent, measure, suite.worlds, scenario, width),
        places(suite, scenario),
        cap,
        perturbations,
        where_it_stands(finished, scenario, "the agents' own trials"),
    )
    folder = finished.out / "figures"
    return Section(
        title=f"Scenario {scenario.name}",
        said=_said(finished, scenario, found),
        text=about(suite, scenario),
        figures={
            f"{scenario.name}-{what}": save(figure, folder, f"{scenario.name}-{what}")
            for what, figure in (("held-out", held_out), ("training", training))
        },
        table=_table(found, scenario, suite.worlds),
        note=_HOW_TO_READ,
        summary=_summary(found, scenario, suite.worlds),
    )


def _said(
    finished: FinishedSuite, scenario: ScenarioConfig, found: dict[str, dict[str, Moment]]
) -> tuple[str, ...]:
    scores = {
        f"{name}{_MORE.get(name, '')}": {
            label: of_agent[name].worlds[MOTIONS] for label, of_agent in found.items() if name in of_agent
        }
        for name in MOMENTS
    }
    return in_words(finished, scenario, MOTIONS, {when: each for when, each in scores.items() if each})


_MORE = {"before": " the first perturbation", "right after": " it"}
_COLUMNS = (
    "agent",
    "when",
    "worlds",
    "lifetime motions",
    "success",
    "rendezvous",
    "motions per reach",
    "interquartile mean",
    "worst tenth",
    "among reached",
    "distance (mm)",
)


def _table(found: dict[str, dict[str, Moment]], scenario: ScenarioConfig, worlds: int) -> Table:
    rows = []
    for agent, of_agent in found.items():
        if not of_agent:
            cap = f"{scenario.env.max_episode_steps}"
            shown = ["no run finished", f"0 of {worlds}", "–", "0 %", "0 %", cap, cap, cap, "–", "–"]
            rows.append([agent, *shown])
        for name, moment in _in_order(of_agent):
            among, motions = moment.among_reached(), moment.motions()
            rows.append(
                [
                    agent,
                    name,
                    f"{moment.finished} of {worlds}",
                    _range(*moment.lifetime_motions),
                    percent(moment.share(SUCCESS)),
                    percent(moment.share(RENDEZVOUS)),
                    *map(number, (motions[MOTIONS], motions[f"{MOTIONS}_iqm"])),
                    f"{motions[f'{MOTIONS}_worst_decile'].value:.1f}",
                    "–" if among is None else number(among),
                    f"{moment.distance_mm:.0f}",
                ]
            )
    return Table("held_out", scenario.name, pd.DataFrame(rows, columns=list(_COLUMNS)))


def _summary(found: dict[str, dict[str, Moment]], scenario: ScenarioConfig, worlds: int) -> list[SummaryRow]:
    rows = []
    for agent, of_agent in found.items():
        for name, moment in _in_order(of_agent):
            where = scenario.name, "held_out", agent, name
            numbers = {SUCCESS: moment.share(SUCCESS), RENDEZVOUS: moment.share(RENDEZVOUS)}
            rows += [
                *(
                    summary_row(*where, measure, each, len(moment.worlds))
                    for measure, each in {**numbers, **moment.motions()}.items()
                ),
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


def _range(low: int, high: int) -> str:
    return f"{low:,}" if low == high else f"{low:,} – {high:,}"
