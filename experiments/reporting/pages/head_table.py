"""The one table of a suite: what each agent must know, how well it reaches, and how soon."""

import math

import pandas as pd

from experiments.config.suite import AgentConfig, ScenarioConfig, SweepConfig
from experiments.reporting.agents_in_words import in_words
from experiments.reporting.by_trial.estimates import COARSE, blocks, edges_of
from experiments.reporting.by_trial.figure import span
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    FinishedSuite,
    with_cost,
    worlds_of,
)
from experiments.reporting.held_out.estimates import AT_THE_END, BEFORE, RIGHT_AFTER, moments
from experiments.reporting.held_out.thresholds import AFTER, BEGINNING, GOOD, Times, times_to_good
from experiments.reporting.pages.perturbations_in_words import knocks
from experiments.reporting.sweep.estimates import points
from experiments.reporting.tables import NOTHING, Table
from experiments.statistics import median_time

_IN_WORDS = {
    "`object_registers`": "where to go",
    "`joint_angles`": "its joint angles",
    "`joint_zeros`": "where its joints have their zeros",
    "`gripper_position`": "where its gripper is in the room",
    "image scale": "image size",
    "noise": "image noise",
    "camera model": "how cameras project",
    "arm": "its arm",
    "chain of joints": "that its arm is a chain",
    "mount": "where cameras stand",
    "reward": "a reward",
    "word limit": "motor strength",
    "training worlds": "worlds to train in",
}
"""Privileged observations, and prior knowledge."""


def head_part(finished: FinishedSuite) -> ScenarioConfig | SweepConfig:
    """What the head of a suite is about: its first scenario with a change and held-out trials, if any."""
    suite = finished.suite
    held_out = [each for each in suite.scenarios if suite.evaluation_of(each)]
    changed = [each for each in held_out if each.perturbations]
    return (*changed, *held_out, *suite.parts)[0]


def head_table(finished: FinishedSuite) -> Table:
    """The table of `head_part`."""
    return table_of(finished, head_part(finished))


def table_of(finished: FinishedSuite, part: ScenarioConfig | SweepConfig) -> Table:
    """A scenario or sweep in at most four columns, without intervals; agents in words, in the suite's order.

    With held-out trials: motions per reach before and right after the first change, or at the end where there
    is none, and the motions lived before it reaches. Else the first and the last trials, or values.
    """
    if isinstance(part, SweepConfig):
        found, note = _of_sweep(finished, part)
    elif finished.suite.evaluation_of(part):
        found, note = _of_held_out(finished, part)
    else:
        found, note = _of_trials(finished, part)
    rows = [
        {
            "agent": in_words(agent.label, agent.name),
            "what it must know": known_in_words(finished.must_know(agent)),
            **found[agent.label],
        }
        for agent in finished.suite.agents_in(part)
    ]
    return Table(part.name, f"{finished.suite.name}: {part.name}", pd.DataFrame(rows), note=note)


def known_in_words(must_know: str) -> str:
    """What an agent must know, for who has read nothing else."""
    return ", ".join(_IN_WORDS.get(each, each) for each in must_know.split(", "))


_Cells = dict[str, dict[str, str]]
"""By the agent's label and the column."""


def _of_held_out(finished: FinishedSuite, scenario: ScenarioConfig) -> tuple[_Cells, str]:
    rows = with_cost(finished.results, scenario)
    cap = scenario.env.max_episode_steps
    changes = bool(scenario.perturbations)
    shown = (BEFORE, RIGHT_AFTER) if changes else (AT_THE_END,)
    column = f"motions per reach {' → '.join(shown)}{' the knock' * changes}"
    until_good = f"motions until {100 * GOOD:.0f} % of trials succeed{' → again after it' * changes}"
    found = {}
    for agent in finished.suite.agents_in(scenario):
        label, worlds = agent.label, worlds_of(finished.suite, agent.label)
        of_agent = moments(rows, label, worlds, cap)
        cells = [_motions(of_agent[each].motions().value) if each in of_agent else NOTHING for each in shown]
        times = times_to_good(rows, label, worlds)
        until = [_until(times.get(stretch)) for stretch in (BEGINNING, AFTER)[: 1 + changes]]
        found[label] = {column: " → ".join(cells), until_good: " → ".join(until)}
    met = knocks(scenario)
    knock = f" The knock: {met[0].words}." if met else ""
    note = f"The median world, in trials that only test; one that fails counts as {cap} motions.{knock}"
    return found, note


def _until(times: Times | None) -> str:
    if times is None:
        return NOTHING
    at, good, latest = times
    median = median_time(at, good).value
    return f"not in {latest:,.0f}" if math.isinf(median) else f"{median:,.0f}"


def _of_trials(finished: FinishedSuite, scenario: ScenarioConfig) -> tuple[_Cells, str]:
    rows = with_cost(finished.results, scenario)
    own, cap = rows[rows["phase"] == "train"], scenario.env.max_episode_steps
    edges = edges_of(scenario, (1, *COARSE))
    column = f"motions per reach in trial 1 → trials {span(*edges[-2:])}"

    def cell(agent: AgentConfig) -> str:
        worlds = worlds_of(finished.suite, agent.label)
        of_blocks = blocks(own, agent.label, MOTIONS, worlds, edges, cap).estimates()
        return f"{_motions(of_blocks[0].value)} → {_motions(of_blocks[-1].value)}"

    note = f"Of the median world, in the agents' own trials; one that fails counts as {cap} motions."
    return {agent.label: {column: cell(agent)} for agent in finished.suite.agents_in(scenario)}, note


def _of_sweep(finished: FinishedSuite, sweep: SweepConfig) -> tuple[_Cells, str]:
    ends = sweep.over[0], sweep.over[-1]
    column = f"{RENDEZVOUS} at {sweep.vary} {ends[0]:g} → {ends[1]:g}"

    def cell(agent: AgentConfig) -> str:
        of_values = points(finished.results, sweep, agent.label, worlds_of(finished.suite, agent.label))
        shares = [each.rendezvous for each in (of_values[0], of_values[-1])]
        return " → ".join(f"{each.value:.0%}".replace("%", " %") if each else NOTHING for each in shares)

    note = "Share of trials that end with an observed rendezvous; one trial a world, without learning."
    return {agent.label: {column: cell(agent)} for agent in finished.suite.agents_in(sweep)}, note


def _motions(found: float) -> str:
    return NOTHING if math.isnan(found) else f"{found:,.1f}"
