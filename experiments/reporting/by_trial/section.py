"""The part of the report about a scenario whose lives are counted in trials."""

from itertools import pairwise

from experiments.config.suite import ScenarioConfig
from experiments.reporting.by_trial.figure import span, trial_curves
from experiments.reporting.by_trial.summary import COARSE, FINE, blocks, edges_of, trial_costs
from experiments.reporting.held_out import figure as figures
from experiments.reporting.held_out.section import about, perturbations_met
from experiments.reporting.held_out.summary import MOTIONS, SECONDS, SUCCESS, with_cost
from experiments.reporting.pages import Section, Table, number, percent
from experiments.reporting.results import Finished

_HOW_TO_READ = (
    "The agents' own trials, in which they learn. Every number: each world's mean over the trials of a "
    "block, then the mean over worlds, with a 95 % bootstrap over worlds. A failed trial counts as the cap "
    "in motions, and as going on to it at its own pace in robot seconds. A run that did not finish counts "
    "as no success, as the cap, and as the slowest trial of any agent. Blocks begin anew where the "
    "schedule strikes."
)


def trial_section(finished: Finished, scenario: ScenarioConfig) -> Section:
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
    table = Table(["trials", "agent", "motions per reach", "robot seconds per reach", "success"], [])
    of_agent = {
        label: [
            blocks(costs, label, measure, suite.worlds, coarse, cap).cells()
            for measure in (MOTIONS, SECONDS, SUCCESS)
        ]
        for label in labels
    }
    for i, (first, end) in enumerate(pairwise(coarse)):
        for label, (motions, seconds, success) in of_agent.items():
            row = [span(first, end), label, number(motions[i], 2), number(seconds[i]), percent(success[i], 1)]
            table.rows.append(row)
    return Section(
        title=f"Scenario {scenario.name}, trial by trial",
        text=about(suite, scenario),
        figures={name: figures.save(figure, finished.out / "figures", name)},
        table=table,
        note=_HOW_TO_READ,
    )
