"""The part of the report about a scenario whose lifetimes are counted in trials."""

from itertools import pairwise

import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.by_trial.estimates import COARSE, FINE, blocks, edges_of, trial_costs
from experiments.reporting.by_trial.figure import span, trial_curves
from experiments.reporting.finished_suite import (
    MOTIONS,
    SECONDS,
    SUCCESS,
    FinishedSuite,
    about,
    perturbations_met,
    with_cost,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.style import save
from experiments.reporting.tables import Table, number, percent

_HOW_TO_READ = (
    "The agents' own trials, in which they learn. Every number: each world's mean over the trials of a "
    "block, then the mean over worlds, with a 95 % bootstrap over worlds. A failed trial counts as the cap "
    "in motions, and as going on to it at its own pace in robot seconds. A run that did not finish counts "
    "as no success, as the cap, and as the slowest trial of any agent. Blocks begin anew where the "
    "schedule perturbs the world."
)


def trial_section(finished: FinishedSuite, scenario: ScenarioConfig) -> Section:
    """Motions and robot seconds per reach against trials, and the table of their blocks."""
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents)
    costs = trial_costs(with_cost(finished.results, scenario), scenario)
    fine = edges_of(scenario, FINE)
    figure = trial_curves(
        f"{scenario.name}: the agents' own trials",
        lambda agent, measure: blocks(costs, agent, measure, suite.worlds, fine, cap),
        labels,
        fine,
        perturbations_met(finished, scenario, "trials"),
    )
    name = f"{scenario.name}-trials"
    coarse = edges_of(scenario, COARSE)
    columns = ["trials", "agent", "motions per reach", "robot seconds per reach", "success"]
    rows, summary = [], []
    of_agent = {
        label: [
            blocks(costs, label, measure, suite.worlds, coarse, cap).estimates()
            for measure in (MOTIONS, SECONDS, SUCCESS)
        ]
        for label in labels
    }
    for i, (first, end) in enumerate(pairwise(coarse)):
        for label, (motions, seconds, success) in of_agent.items():
            block = span(first, end)
            rows.append([block, label, number(motions[i], 2), number(seconds[i]), percent(success[i], 1)])
            summary += [
                summary_row(scenario.name, "by_trial", label, block, measure, estimates[i], suite.worlds)
                for measure, estimates in ((MOTIONS, motions), (SECONDS, seconds), (SUCCESS, success))
            ]
    return Section(
        title=f"Scenario {scenario.name}, trial by trial",
        text=about(suite, scenario),
        figures={name: save(figure, finished.out / "figures", name)},
        table=Table("by_trial", scenario.name, pd.DataFrame(rows, columns=columns)),
        note=_HOW_TO_READ,
        summary=summary,
    )
