"""Lifetimes counted in trials: learning curves in blocks of trials that begin anew after each event."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import fill
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import HINGE_SPEED
from experiments.config.environment import EnvironmentConfig, as_told
from experiments.config.in_words import again_and_again, knocks
from experiments.config.suite import ScenarioConfig
from experiments.evaluation import robot_seconds_at
from experiments.reporting.figures import (
    DARK_GREY,
    STYLE,
    LineEnd,
    draw_worlds,
    drawn_in_words,
    in_words,
    label_lines,
    lines_of,
    marks,
    motions_axis,
    save,
    say,
)
from experiments.reporting.finished_suite import (
    HOW_FAR,
    MOTIONS,
    RENDEZVOUS,
    SECONDS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    Distances,
    FinishedSuite,
    about,
    about_environment,
    distance_rows,
    distance_tables,
    distances,
    few_worlds,
    judged_alike,
    where_it_stands,
    with_cost,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, counted, number, percent, with_most, written
from experiments.running.results_folder import FIGURES
from experiments.statistics import Array, Estimate, mean_shares, medians, most_worlds

FINE = (1, 5, 10, 25, 50, 100, 150, 200, 300, 400, 500, 1_000, 2_000, 5_000)
COARSE = (25, 50, 100, 150, 300, 400, 500, 1_000, 2_000, 5_000)
"""After how many trials a block ends, counted from the last event."""
LOOKS = (0.2, 1.0, 4.0)
"""Seconds a look: a camera of today and a fast arm; in between; what the paper's 50 s a grasp come to."""
_ROOM = 18
"""Letters of what happened, in a line above the panel."""
_HOW_TO_READ = (
    "The agents' own trials, in which they learn. Motions per reach: each world's mean over the trials of a "
    "block, then the median world, and in brackets the 10th to the 90th percentile of worlds (of fewer "
    f"than 20 the lowest and the highest). Rendezvous, {SUCCESS_IN_WORDS.lower()[:-1]}: means over worlds "
    "with 95 % intervals. A trial without a rendezvous counts as the cap in motions, and as going on to "
    "it at its own pace in robot seconds. Robot seconds are of the median world where a look (settling "
    f"and evaluating both images, after each motion and after the way home) takes {LOOKS[0]:g} to "
    f"{LOOKS[-1]:g} s: the paper tells none, so they confirm none of its seconds. A run that did not "
    "finish counts as no success, as the cap, and as so many motions of a full turn. Blocks begin anew "
    "where the schedule perturbs the world."
)


def seconds_at(look: float) -> str:
    """The measure of robot seconds per reach where a look takes so many seconds."""
    return f"{SECONDS}_at_{look:g}"


@dataclass(frozen=True, slots=True)
class Blocks:
    """A measure of one agent: means of blocks (worlds, blocks) of trials, between `edges` (blocks + 1,)."""

    edges: Array
    runs: Array
    shares: bool

    def estimates(self) -> list[Estimate]:
        """Each block's mean of shares over worlds, or motions or seconds of the median world."""
        return mean_shares(self.runs) if self.shares else medians(self.runs)


@dataclass(frozen=True, slots=True)
class OwnTrials:
    """The agents' own trials in a scenario: rows of `with_seconds`, and how many runs each label has."""

    scenario: ScenarioConfig
    rows: pd.DataFrame
    worlds: dict[str, int]

    @property
    def cap(self) -> int:
        """Motions after which a trial has failed."""
        return self.scenario.env.max_episode_steps

    def blocks(self, agent: str, measure: str, edges: Array) -> Blocks:
        """A measure's means over blocks of an agent's trials, between edges that `edges_of` returned.

        Runs without any row failed, and are worst throughout: no success, `cap` motions, and the seconds of
        `cap` motions of a full turn.
        """
        worst = {SUCCESS: 0.0, RENDEZVOUS: 0.0, MOTIONS: float(self.cap)}
        worst |= {seconds_at(look): slowest_seconds(self.cap, look) for look in LOOKS}
        mine = self.rows[self.rows["agent"] == agent]
        mine = mine.assign(block=np.searchsorted(edges, mine["trial"], side="right") - 1)
        found = mine.pivot_table(index="world", columns="block", values=measure, aggfunc="mean")
        runs = found.reindex(index=range(self.worlds[agent]), columns=range(len(edges) - 1))
        runs.loc[~runs.index.isin(found.index)] = worst[measure]
        return Blocks(edges, runs.to_numpy(dtype=float), measure in (SUCCESS, RENDEZVOUS))

    def distances(self, agent: str, first: float, end: float) -> Distances | None:
        """Those of an agent's trials in a block; None where no run has finished."""
        rows = self.rows
        mine = rows[(rows["agent"] == agent) & (rows["trial"] >= first) & (rows["trial"] < end)]
        return distances(mine) if len(mine) else None


def own_trials(finished: FinishedSuite, scenario: ScenarioConfig) -> OwnTrials:
    """What the agents' own trials in a scenario come to."""
    rows = with_cost(finished.results, scenario)
    return OwnTrials(scenario, with_seconds(rows, scenario), finished.worlds_in(scenario))


def with_seconds(rows: pd.DataFrame, scenario: ScenarioConfig) -> pd.DataFrame:
    """The agents' own trials, of the rows of `with_cost`, in robot seconds per reach too."""
    mine, cap = rows[rows["phase"] == "train"], scenario.env.max_episode_steps
    return mine.assign(**{seconds_at(look): seconds_per_reach(mine, cap, look) for look in LOOKS})


def edges_of(scenario: ScenarioConfig, ends: Sequence[int]) -> Array:
    """Where blocks of trials begin and end: `ends` after the beginning and each `at: {trial: n}`."""
    trials, _ = scenario.length
    events = {each["at"]["trial"] for each in scenario.perturbations if "trial" in each.get("at", {})}
    found = {trials}
    for start, stop in pairwise(sorted({0, trials, *events})):
        found |= {start, *(start + end for end in ends if start + end < stop)}
    return np.array(sorted(found), float)


def seconds_per_reach(rows: pd.DataFrame, cap: int, look: float) -> "pd.Series[float]":
    """Robot seconds of each trial, of the rows of `with_cost`.

    A trial without a rendezvous counts as going on to the cap at its own pace, but not as more than
    `slowest_seconds`.
    """
    longer = (cap / rows["motions"]).where(rows[RENDEZVOUS] == 0, 1.0)
    seconds: pd.Series[float] = longer * robot_seconds_at(look, rows[SECONDS], rows["motions"])
    return seconds.clip(upper=slowest_seconds(cap, look))


def slowest_seconds(cap: int, look: float) -> float:
    """Robot seconds of `cap` motions, and of the way home, each a full turn: the most that a reach counts."""
    return (cap + 1) * (look + 2 * np.pi / HINGE_SPEED)


def span(first: float, end: float) -> str:
    """The trials of a block in words, counted from 1."""
    return f"{end:,.0f}" if end == first + 1 else f"{first + 1:,.0f}–{end:,.0f}"


def trial_section(finished: FinishedSuite, own: OwnTrials) -> Section:
    """Motions per reach against trials, and the table of their blocks."""
    scenario, name = own.scenario, own.scenario.name
    edges, measures = edges_of(scenario, COARSE), (MOTIONS, *map(seconds_at, LOOKS), SUCCESS, RENDEZVOUS)
    of_agent = {
        label: {measure: own.blocks(label, measure, edges) for measure in measures} for label in own.worlds
    }
    estimates = {
        label: {measure: each.estimates() for measure, each in of_blocks.items()}
        for label, of_blocks in of_agent.items()
    }
    shown, intervals, far, summary = [], [], [], []
    for i, (first, end) in enumerate(pairwise(edges)):
        for label, amount in own.worlds.items():
            block, found = span(first, end), {measure: each[i] for measure, each in estimates[label].items()}
            motions = with_most(found[MOTIONS].value, most_worlds(of_agent[label][MOTIONS].runs[:, i]), ".1f")
            seconds = " – ".join(f"{found[seconds_at(look)].value:,.0f}" for look in (LOOKS[0], LOOKS[-1]))
            shown.append([block, label, motions, seconds, written(found[RENDEZVOUS].value, ".1%")])
            shares = (percent(found[share], 1) for share in (RENDEZVOUS, SUCCESS))
            intervals.append([block, label, number(found[MOTIONS], 2), *shares])
            summary += [
                summary_row(name, "by_trial", label, block, measure, each, amount)
                for measure, each in found.items()
            ]
            if how_far := own.distances(label, first, end):
                far.append(([block, label], how_far))
                summary += distance_rows(name, "by_trial", label, block, how_far)
    of_distances = distance_tables(name, scenario.env, ["trials", "agent"], far)
    band = f"robot seconds, {LOOKS[0]:g} – {LOOKS[-1]:g} s a look"
    columns, folder = ["trials", "agent", "motions per reach", band, "rendezvous"], finished.out / FIGURES
    with_intervals = ["trials", "agent", "motions per reach", "rendezvous", "success"]
    return Section(
        title=f"{name}: trial by trial",
        text=about(finished, scenario),
        figures={f"{name}-trials": save(trial_picture(finished, own), folder, f"{name}-trials")},
        tables=(
            Table.of(f"{name}-trials", f"{name}, trial by trial", columns, shown),
            Table.of(f"{name}-trials-intervals", f"{name}, with intervals", with_intervals, intervals),
            *of_distances,
        ),
        note=_HOW_TO_READ + HOW_FAR * len(of_distances),
        summary=summary,
    )


def trial_picture(finished: FinishedSuite, own: OwnTrials) -> Figure:
    """Motions per reach, every block of trials of the same width; knocks are marked where they fall."""
    scenario, lines = own.scenario, lines_of(finished.suite.agents)
    agents, met, edges = finished.suite.agents_in(scenario), knocks(scenario) or (), edges_of(scenario, FINE)
    always = [again_and_again(scenario), *(knock.words for knock in met if not knock.trial)]
    title = "\n".join([f"Motions per reach (a failure counts as {own.cap})", *filter(None, always)])
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(7.6, 4.3), layout="constrained")
        motions_axis(axes, own.cap)
        place, ends = np.arange(len(edges) - 1) + 0.5, []
        for agent in agents:
            line, runs = lines[agent.label], own.blocks(agent.label, MOTIONS, edges).runs
            draw_worlds(axes, place, runs, line, len(agents))
            end = float(np.median(runs[:, -1]))
            ends.append(LineEnd(place[-1], end, in_words(agent.label, agent.name), line["color"]))
        names = [span(first, end) for first, end in pairwise(edges)]
        axes.set_xticks(place, names, rotation=60, ha="right", rotation_mode="anchor")
        axes.tick_params(axis="x", labelsize=8)
        axes.set(xlim=(0, len(names)), xlabel="trials")
        above: Any = {"xytext": (0, 3), "textcoords": "offset points", "fontsize": 9, "ha": "center"}
        for knock in met:
            if knock.trial:
                x = float(np.interp(knock.trial, edges, np.arange(len(edges))))
                axes.axvline(x, color=DARK_GREY, linewidth=1.2)
                axes.annotate(fill(knock.words, _ROOM), (x, 1), xycoords=("data", "axes fraction"), **above)
        say(figure, title, f"{_where(own)} {drawn_in_words(min(own.worlds.values()), len(agents))}")
        label_lines(axes, ends, 10)
    return figure


def _where(own: OwnTrials) -> str:
    return where_it_stands(own.scenario, "The agents' own trials", own.worlds.values())


# Many arms side by side, in one figure and one table.

_MARKERS = "osD^vPX"
_ARMS = (
    "The agents' own trials, in which they learn; nothing is set for an arm. Motions per reach of the "
    "median world, in the first trial of a life → in its last block of trials; a trial without a "
    "rendezvous counts as the cap. Rendezvous: the share of all trials, mean over worlds. Brackets: 95 % "
    "intervals over worlds."
)


def many_arms(scenarios: tuple[ScenarioConfig, ...]) -> bool:
    """Whether scenarios differ in their arms, each a lifetime of trials in which no world is perturbed.

    All of as many trials, judged alike and with the same agents: else they do not stand side by side.
    """
    arms = {json.dumps(scenario.env.model_dump(mode="json")["arm"], sort_keys=True) for scenario in scenarios}
    steady = all(each.trials and not each.perturbations for each in scenarios)
    alike = len({(each.trials, each.agents) for each in scenarios}) == 1
    return steady and alike and judged_alike(scenarios) and len(arms) > 1


def arms_sections(finished: FinishedSuite, trials: Sequence[OwnTrials]) -> list[Section]:
    """Agents by arms in one figure and table, and what each arm is."""
    first = trials[0].scenario
    edges = edges_of(first, (1, *COARSE))
    names = [span(start, end) for start, end in pairwise(edges)]
    ends = [f"trial {names[0]}", f"trials {names[-1]}"]
    rows, far, summary = [], [], []
    motions: dict[tuple[str, str], Array] = {}
    for own in trials:
        arm = own.scenario.name
        for label, worlds in own.worlds.items():
            blocks = own.blocks(label, MOTIONS, edges)
            success, rendezvous = (
                own.blocks(label, measure, edges[[0, -1]]).estimates()[0] for measure in (SUCCESS, RENDEZVOUS)
            )
            found = blocks.estimates()
            motions[arm, label] = np.median(blocks.runs[:, [0, -1]], axis=0)
            rows.append([arm, label, number(found[0]), number(found[-1]), percent(rendezvous, 1)])
            measured = [(block, MOTIONS, each) for block, each in zip(names, found, strict=True)]
            measured += [("all", SUCCESS, success), ("all", RENDEZVOUS, rendezvous)]
            summary += [summary_row(arm, "by_arm", label, *each, worlds) for each in measured]
            if how_far := own.distances(label, *edges[[0, -1]]):
                far.append(([arm, label], how_far))
                summary += distance_rows(arm, "by_arm", label, "all", how_far)
    columns = ["arm", "agent", *ends, "rendezvous"]
    of_distances = distance_tables("arms", first.env, ["arm", "agent"], far)
    environments = [[own.scenario.name, about_environment(own.scenario.env)] for own in trials]
    what = Table.of("arms-environments", "What each arm is", ["arm", "environment"], environments)
    figure = _arms_figure(finished, trials, ends, motions)
    return [
        Section(
            title="Agents by arms",
            text=(
                f"At most {trials[0].cap} motions a trial, {first.trials} trials a lifetime, "
                f"{counted(finished.fewest_worlds(first), 'world')}, the same for every agent."
                f"{few_worlds(finished, first)}"
            ),
            figures={"arms": save(figure, finished.out / FIGURES, "arms")},
            tables=(Table.of("arms", "Agents by arms", columns, rows), *of_distances),
            note=_ARMS + HOW_FAR * len(of_distances),
            summary=summary,
        ),
        Section(title="What each arm is", tables=(what,)),
    ]


def _arms_figure(
    finished: FinishedSuite,
    trials: Sequence[OwnTrials],
    titles: Sequence[str],
    motions: Mapping[tuple[str, str], Array],
) -> Figure:
    """A panel for the first and one for the last trials, a row an arm, those of few motors above.

    The points are `motions` per reach in the median world, by arm and agent (panels,).
    """
    agents, lines = finished.suite.agents_in(trials[0].scenario), lines_of(finished.suite.agents)
    motors = {own.scenario.name: _motors(own.scenario.env) for own in trials}
    rows, cap = sorted(motors, key=lambda arm: motors[arm]), trials[0].cap
    with plt.rc_context(STYLE):
        size = 9.4, 1.2 + 0.3 * len(rows)
        figure, panels = plt.subplots(1, len(titles), figsize=size, sharey=True, layout="constrained")
        for end, (axes, title) in enumerate(zip(panels, titles, strict=True)):
            for i, agent in enumerate(agents):
                shift = 0.6 * ((i + 0.5) / len(agents) - 0.5)
                marker = {"linestyle": "", "marker": _MARKERS[i % len(_MARKERS)], "markersize": 5}
                axes.plot(
                    [motions[arm, agent.label][end] for arm in rows],
                    [row + shift for row in range(len(rows))],
                    **{**lines[agent.label], **marker},
                    label=in_words(agent.label, agent.name),
                )
            axes.set(xscale="log", xlim=(0.9, 1.1 * cap), xlabel="motions per reach", title=title)
            marks(axes.xaxis, [1, 2, 5, 10, 20, cap])
        panels[0].set_yticks(range(len(rows)), [f"{arm} ({motors[arm]} motors)" for arm in rows])
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper")
        said = f"{_where(trials[0])} Points: the median world."
        say(figure, f"Motions per reach with each arm (a failure counts as {cap})", said)
    return figure


def _motors(env: EnvironmentConfig) -> int:
    return len(MOVEMASTER.motors if isinstance(env.arm, str) else as_told(env.arm)["motors"])
