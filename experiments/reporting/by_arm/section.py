"""The part of the report that sets agents and arms side by side."""

import json
from itertools import pairwise

import numpy as np
import pandas as pd

from calfree_gym.robot.arms.movemaster import MOVEMASTER
from experiments.config.environment import EnvironmentConfig, as_told
from experiments.config.suite import ScenarioConfig
from experiments.reporting.agents_in_words import lines_of
from experiments.reporting.by_arm.figure import arms_figure
from experiments.reporting.by_trial.estimates import COARSE, blocks, edges_of
from experiments.reporting.by_trial.figure import span
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    FinishedSuite,
    about_environment,
    few_worlds,
    where_it_stands,
    with_cost,
    worlds_of,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.pages.style import save
from experiments.reporting.tables import Table, counted, number, percent
from experiments.statistics import Array, Estimate

ALL, BY_ARM = "all", "by_arm"
_FIRST = 1
_OWN = "The agents' own trials"

_HOW_TO_READ = (
    "The agents' own trials, in which they learn; nothing is set for an arm. Motions per reach of the "
    "median world, in the first trial of a life → in its last block of trials; a trial without a "
    "rendezvous counts as the cap. Rendezvous: the share of all trials, mean over worlds. Brackets: 95 % "
    "intervals over worlds."
)


def many_arms(scenarios: tuple[ScenarioConfig, ...]) -> bool:
    """Whether scenarios differ in their arms, each a lifetime of trials in which no world is perturbed.

    All of as many trials, and with the same agents: else they do not stand side by side.
    """
    arms = {json.dumps(scenario.env.model_dump(mode="json")["arm"], sort_keys=True) for scenario in scenarios}
    steady = all(each.trials and not each.perturbations for each in scenarios)
    alike = len({(each.trials, each.agents) for each in scenarios}) == 1
    return steady and alike and len(arms) > 1


def arms_sections(finished: FinishedSuite) -> list[Section]:
    """Agents by arms in one figure and table, and all numbers with their intervals in another."""
    suite = finished.suite
    summary = []
    found: dict[tuple[str, str, str], Array] = {}
    for scenario in suite.scenarios:
        cap = scenario.env.max_episode_steps
        costs = with_cost(finished.results, scenario)
        costs = costs[costs["phase"] == "train"]
        edges = edges_of(scenario, (_FIRST, *COARSE))
        names = [span(first, end) for first, end in pairwise(edges)]
        for label in (agent.label for agent in suite.agents_in(scenario)):
            worlds = worlds_of(suite, label)
            motions = blocks(costs, label, MOTIONS, worlds, edges, cap)
            of_blocks = motions.estimates()
            of_all = {
                measure: blocks(costs, label, measure, worlds, edges[[0, -1]], cap).estimates()[0]
                for measure in (SUCCESS, RENDEZVOUS)
            }
            summary += [
                summary_row(scenario.name, BY_ARM, label, block, MOTIONS, each, worlds)
                for block, each in zip(names, of_blocks, strict=True)
            ]
            summary += [
                summary_row(scenario.name, BY_ARM, label, ALL, measure, each, worlds)
                for measure, each in of_all.items()
            ]
            found |= {
                (scenario.name, label, block): of_worlds
                for block, of_worlds in zip(names, motions.runs.T, strict=True)
            }
    first, lines = suite.scenarios[0], lines_of(suite.agents)
    amounts = [worlds_of(suite, agent.label) for agent in suite.agents_in(first)]
    figure = arms_figure(
        {scenario.name: _motors(scenario.env) for scenario in suite.scenarios},
        {f"trial {names[0]}": names[0], f"trials {names[-1]}": names[-1]},
        found,
        [(agent, lines[agent.label]) for agent in suite.agents_in(first)],
        first.env.max_episode_steps,
        f"{where_it_stands(first, _OWN, *amounts)} Points: the median world.",
    )
    return [
        Section(
            title="Agents by arms",
            text=_about(finished),
            figures={"arms": save(figure, finished.out / "figures", "arms")},
            tables=(_table(pd.DataFrame(summary)),),
            note=_HOW_TO_READ,
            summary=summary,
        ),
        Section(title="What each arm is", tables=(_environments(finished),)),
    ]


def _motors(env: EnvironmentConfig) -> int:
    return len(MOVEMASTER.motors if isinstance(env.arm, str) else as_told(env.arm)["motors"])


def _about(finished: FinishedSuite) -> str:
    suite = finished.suite
    first, *_ = suite.scenarios
    return (
        f"At most {first.env.max_episode_steps} motions a trial, {first.trials} trials a lifetime, "
        f"{counted(finished.fewest_worlds(first), 'world')}, the same for every agent."
        f"{few_worlds(finished, first)}"
    )


def _environments(finished: FinishedSuite) -> Table:
    rows = [[scenario.name, about_environment(scenario.env)] for scenario in finished.suite.scenarios]
    return Table("arms-environments", "What each arm is", pd.DataFrame(rows, columns=["arm", "environment"]))


def _table(numbers: pd.DataFrame) -> Table:
    """Arms and agents: motions in the first and the last trials, and the share of rendezvous.

    Args:
        numbers: The rows of `summary_row`.
    """
    found = {
        (row.scenario, row.agent, row.moment, row.measure): Estimate(row.value, row.low, row.high)
        for row in numbers.fillna(np.nan).itertuples()
    }
    moments = [moment for moment in numbers["moment"].unique() if moment != ALL]
    rows = [
        [
            arm,
            agent,
            number(found[arm, agent, moments[0], MOTIONS]),
            number(found[arm, agent, moments[-1], MOTIONS]),
            percent(found[arm, agent, ALL, RENDEZVOUS], 1),
        ]
        for arm, agent in numbers[["scenario", "agent"]].drop_duplicates().itertuples(index=False)
    ]
    columns = ["arm", "agent", f"trial {moments[0]}", f"trials {moments[-1]}", "rendezvous"]
    return Table("arms", "Agents by arms", pd.DataFrame(rows, columns=columns))
