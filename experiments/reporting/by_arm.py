"""One suite, many arms: agents and arms side by side, in one figure and one table."""

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from calfree_gym.robot.arms.movemaster import MOVEMASTER
from experiments.config.environment import EnvironmentConfig, as_told
from experiments.config.suite import AgentConfig, ScenarioConfig
from experiments.reporting.agents_in_words import in_words, lines_of
from experiments.reporting.by_trial import COARSE, OwnTrials, edges_of, span
from experiments.reporting.figures import STYLE, Line, save, say
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    FinishedSuite,
    about_environment,
    few_worlds,
    where_it_stands,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, counted, number, percent
from experiments.statistics import Array

_MARKERS = "osD^vPX"
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


def arms_sections(finished: FinishedSuite, trials: Sequence[OwnTrials]) -> list[Section]:
    """Agents by arms in one figure and table, and what each arm is."""
    suite, first = finished.suite, finished.suite.scenarios[0]
    edges, cap = edges_of(first, (1, *COARSE)), first.env.max_episode_steps
    names = [span(start, end) for start, end in pairwise(edges)]
    rows, summary = [], []
    ends: dict[tuple[str, str], Array] = {}
    for own in trials:
        arm = own.scenario.name
        for label, worlds in own.worlds.items():
            motions = own.blocks(label, MOTIONS, edges)
            success, rendezvous = (
                own.blocks(label, measure, edges[[0, -1]]).estimates()[0] for measure in (SUCCESS, RENDEZVOUS)
            )
            found = motions.estimates()
            ends[arm, label] = motions.runs[:, [0, -1]]
            rows.append([arm, label, number(found[0]), number(found[-1]), percent(rendezvous, 1)])
            measured = [*((block, MOTIONS, each) for block, each in zip(names, found, strict=True))]
            measured += [("all", SUCCESS, success), ("all", RENDEZVOUS, rendezvous)]
            summary += [summary_row(arm, "by_arm", label, *each, worlds) for each in measured]
    lines, agents = lines_of(suite.agents), suite.agents_in(first)
    where = where_it_stands(first, "The agents' own trials", trials[0].worlds.values())
    figure = arms_figure(
        {scenario.name: _motors(scenario.env) for scenario in suite.scenarios},
        (f"trial {names[0]}", f"trials {names[-1]}"),
        ends,
        [(agent, lines[agent.label]) for agent in agents],
        cap,
        f"{where} Points: the median world.",
    )
    columns = ["arm", "agent", f"trial {names[0]}", f"trials {names[-1]}", "rendezvous"]
    environments = [[scenario.name, about_environment(scenario.env)] for scenario in suite.scenarios]
    what = Table.of("arms-environments", "What each arm is", ["arm", "environment"], environments)
    return [
        Section(
            title="Agents by arms",
            text=(
                f"At most {cap} motions a trial, {first.trials} trials a lifetime, "
                f"{counted(finished.fewest_worlds(first), 'world')}, the same for every agent."
                f"{few_worlds(finished, first)}"
            ),
            figures={"arms": save(figure, finished.out / "figures", "arms")},
            tables=(Table.of("arms", "Agents by arms", columns, rows),),
            note=_HOW_TO_READ,
            summary=summary,
        ),
        Section(title="What each arm is", tables=(what,)),
    ]


def _motors(env: EnvironmentConfig) -> int:
    return len(MOVEMASTER.motors if isinstance(env.arm, str) else as_told(env.arm)["motors"])


def arms_figure(
    motors: Mapping[str, int],
    titles: Sequence[str],
    ends: Mapping[tuple[str, str], Array],
    agents: Sequence[tuple[AgentConfig, Line]],
    cap: int,
    said: str,
) -> Figure:
    """Motions per reach: a panel for the first and one for the last trials, a row an arm, a point an agent.

    Args:
        motors: By the arm's name, how many it has; arms of few stand above.
        titles: Of the panels.
        ends: By arm and agent: motions per reach in each world, in the first and last trials (worlds, 2).
        agents: With their lines.
        cap: The most motions.
        said: Stands below the panels.
    """
    rows = sorted(motors, key=lambda arm: motors[arm])
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(
            1, len(titles), figsize=(9.4, 1.2 + 0.3 * len(rows)), sharey=True, layout="constrained"
        )
        for end, (axes, title) in enumerate(zip(panels, titles, strict=True)):
            for i, (agent, line) in enumerate(agents):
                shift = 0.6 * ((i + 0.5) / len(agents) - 0.5)
                axes.plot(
                    [np.median(ends[arm, agent.label][:, end]) for arm in rows],
                    [row + shift for row in range(len(rows))],
                    **{**line, "linestyle": "", "marker": _MARKERS[i % len(_MARKERS)], "markersize": 5},
                    label=in_words(agent.label, agent.name),
                )
            axes.set_xscale("log")
            axes.set_xlim(0.9, 1.1 * cap)
            axes.xaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, cap]))
            axes.xaxis.set_minor_locator(NullLocator())
            axes.xaxis.set_major_formatter("{x:g}")
            axes.set_xlabel("motions per reach")
            axes.set_title(title)
        panels[0].set_yticks(range(len(rows)), [f"{arm} ({motors[arm]} motors)" for arm in rows])
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper")
        say(figure, f"Motions per reach with each arm (a failure counts as {cap})", said)
    return figure
