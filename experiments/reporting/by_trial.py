"""Lifetimes counted in trials: learning curves in blocks of trials that begin anew after each event."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calfree_gym.robot.arms.robot import HINGE_SPEED
from experiments.config.in_words import Knock, again_and_again, knocks
from experiments.config.suite import AgentConfig, ScenarioConfig
from experiments.evaluation import robot_seconds_at
from experiments.reporting.agents_in_words import in_words, lines_of
from experiments.reporting.figures import (
    DARK_GREY,
    STYLE,
    Line,
    LineEnd,
    draw_worlds,
    drawn_in_words,
    label_lines,
    motions_axis,
    save,
    say,
)
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SECONDS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    FinishedSuite,
    about,
    where_it_stands,
    with_cost,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent, with_most, written
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
    """One measure of one agent in blocks of trials, over its runs.

    Attributes:
        edges: Trials that have gone at the first block's beginning and at every block's end (blocks + 1,).
        runs: The measure's mean over each block, in the run of each world (worlds, blocks).
        shares: Whether it is a share of trials.
    """

    edges: Array
    runs: Array
    shares: bool

    def estimates(self) -> list[Estimate]:
        """Each block's mean of shares over worlds, or motions or seconds of the median world."""
        return mean_shares(self.runs) if self.shares else medians(self.runs)


@dataclass(frozen=True, slots=True)
class OwnTrials:
    """The agents' own trials in a scenario.

    Attributes:
        scenario: Whose they are.
        rows: The trials, of the rows of `with_cost`, with a column of `seconds_at` for each of LOOKS.
        worlds: By an agent's label, in the suite's order, how many runs there should be.
    """

    scenario: ScenarioConfig
    rows: pd.DataFrame
    worlds: dict[str, int]

    @property
    def cap(self) -> int:
        """Motions after which a trial has failed."""
        return self.scenario.env.max_episode_steps

    def blocks(self, agent: str, measure: str, edges: Array) -> Blocks:
        """A measure's means over blocks of an agent's trials.

        Runs without any row failed, and are worst throughout: no success, `cap` motions, and the seconds of
        `cap` motions of a full turn.

        Args:
            agent: The agent's label.
            measure: SUCCESS, RENDEZVOUS, MOTIONS or one of `seconds_at`.
            edges: What `edges_of` returned.
        """
        worst = {SUCCESS: 0.0, RENDEZVOUS: 0.0, MOTIONS: float(self.cap)}
        worst |= {seconds_at(look): slowest_seconds(self.cap, look) for look in LOOKS}
        mine = self.rows[self.rows["agent"] == agent]
        mine = mine.assign(block=np.searchsorted(edges, mine["trial"], side="right") - 1)
        found = mine.pivot_table(index="world", columns="block", values=measure, aggfunc="mean")
        runs = found.reindex(index=range(self.worlds[agent]), columns=range(len(edges) - 1))
        runs.loc[~runs.index.isin(found.index)] = worst[measure]
        return Blocks(edges, runs.to_numpy(dtype=float), measure in (SUCCESS, RENDEZVOUS))


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
    found = {trials}
    for start, stop in pairwise(sorted({0, trials, *event_trials(scenario)})):
        found |= {start, *(start + end for end in ends if start + end < stop)}
    return np.array(sorted(found), float)


def event_trials(scenario: ScenarioConfig) -> set[int]:
    """The trials before which the schedule perturbs the world, each once."""
    return {e["at"]["trial"] for e in scenario.perturbations if "trial" in e.get("at", {})}


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
    shown, intervals, summary = [], [], []
    for i, (first, end) in enumerate(pairwise(edges)):
        for label, amount in own.worlds.items():
            block, found = span(first, end), {measure: each[i] for measure, each in estimates[label].items()}
            spread = most_worlds(of_agent[label][MOTIONS].runs[:, i])
            seconds = [found[seconds_at(look)].value for look in (LOOKS[0], LOOKS[-1])]
            shown.append(
                [
                    block,
                    label,
                    with_most(found[MOTIONS].value, spread, ".1f"),
                    " – ".join(f"{each:,.0f}" for each in seconds),
                    written(found[RENDEZVOUS].value, ".1%"),
                ]
            )
            shares = (percent(found[share], 1) for share in (RENDEZVOUS, SUCCESS))
            intervals.append([block, label, number(found[MOTIONS], 2), *shares])
            summary += [
                summary_row(name, "by_trial", label, block, measure, each, amount)
                for measure, each in found.items()
            ]
    band = f"robot seconds, {LOOKS[0]:g} – {LOOKS[-1]:g} s a look"
    columns = ["trials", "agent", "motions per reach", band, "rendezvous"]
    with_intervals = ["trials", "agent", "motions per reach", "rendezvous", "success"]
    figure = _figure(finished, own)
    return Section(
        title=f"{name}: trial by trial",
        text=about(finished, scenario),
        figures={f"{name}-trials": save(figure, finished.out / "figures", f"{name}-trials")},
        tables=(
            Table.of(f"{name}-trials", f"{name}, trial by trial", columns, shown),
            Table.of(f"{name}-trials-intervals", f"{name}, with intervals", with_intervals, intervals),
        ),
        note=_HOW_TO_READ,
        summary=summary,
    )


def _figure(finished: FinishedSuite, own: OwnTrials) -> Figure:
    scenario, lines = own.scenario, lines_of(finished.suite.agents)
    agents, met, edges = finished.suite.agents_in(scenario), knocks(scenario) or (), edges_of(scenario, FINE)
    curves = [(each, own.blocks(each.label, MOTIONS, edges), lines[each.label]) for each in agents]
    title = f"Motions per reach (a failure counts as {own.cap})"
    always = [again_and_again(scenario), *(knock.words for knock in met if not knock.trial)]
    where = where_it_stands(scenario, "The agents' own trials", own.worlds.values())
    said = f"{where} {drawn_in_words(min(own.worlds.values()), len(agents))}"
    return trial_curves("\n".join([title, *filter(None, always)]), curves, own.cap, met, said)


def trial_curves(
    title: str,
    curves: Sequence[tuple[AgentConfig, Blocks, Line]],
    cap: int,
    knocks: Sequence[Knock],
    said: str,
) -> Figure:
    """Motions per reach; every block of trials has the same width.

    Args:
        title: Stands above.
        curves: Of each agent, with its line.
        cap: Motions after which a trial has failed.
        knocks: Marked where they fall, between trials, where that is known.
        said: Stands below the panel.
    """
    edges = curves[0][1].edges
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(7.6, 4.3), layout="constrained")
        motions_axis(axes, cap)
        place, ends = np.arange(len(edges) - 1) + 0.5, []
        for agent, blocks, line in curves:
            draw_worlds(axes, place, blocks.runs, line, len(curves))
            end = float(np.median(blocks.runs[:, -1]))
            ends.append(LineEnd(place[-1], end, in_words(agent.label, agent.name), line["color"]))
        _name_blocks(axes, edges)
        for knock in knocks:
            if knock.trial:
                _mark(axes, float(np.interp(knock.trial, edges, np.arange(len(edges)))), knock.words)
        say(figure, title, said)
        label_lines(axes, ends, 10)
    return figure


def _mark(axes: Axes, place: float, words: str) -> None:
    axes.axvline(place, color=DARK_GREY, linewidth=1.2)
    words = fill(words, _ROOM)
    axes.annotate(
        words, (place, 1), (0, 3), ("data", "axes fraction"), "offset points", fontsize=9, ha="center"
    )


def _name_blocks(axes: Axes, edges: Array) -> None:
    names = [span(first, end) for first, end in pairwise(edges)]
    axes.set_xticks(np.arange(len(names)) + 0.5, names, rotation=60, ha="right", rotation_mode="anchor")
    axes.tick_params(axis="x", labelsize=8)
    axes.set_xlim(0, len(names))
    axes.set_xlabel("trials")
