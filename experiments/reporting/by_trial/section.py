"""The part of the report about a scenario whose lifetimes are counted in trials."""

from itertools import pairwise

import numpy as np
import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.agents_in_words import lines_of
from experiments.reporting.by_trial.estimates import (
    COARSE,
    FINE,
    LOOKS,
    Blocks,
    blocks,
    edges_of,
    event_trials,
    seconds_at,
    trial_costs,
)
from experiments.reporting.by_trial.figure import span, trial_curves
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    FinishedSuite,
    about,
    where_it_stands,
    with_cost,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.pages.headline import in_words
from experiments.reporting.pages.perturbations_in_words import again_and_again, knocks
from experiments.reporting.pages.style import drawn_in_words, save
from experiments.reporting.tables import Table, number, percent
from experiments.statistics import Array, interquartile_mean

_HOW_TO_READ = (
    "The agents' own trials, in which they learn. Every number: each world's mean over the trials of a "
    "block, then the mean over worlds (and the interquartile mean), with a 95 % interval over worlds. "
    f"{SUCCESS_IN_WORDS} Rendezvous: the last observation was within it. A "
    "trial without a rendezvous counts as the cap in motions, and as going on to it at its own pace in "
    "robot seconds. Robot seconds are means where a look (settling and evaluating both images, after each "
    f"motion and after the way home) takes {LOOKS[0]:g} to {LOOKS[-1]:g} s: the paper tells none, so they "
    "confirm none of its seconds. A run that did not finish counts as no success, as the cap, and as "
    "so many motions of a full turn. Blocks begin anew where the schedule perturbs the world."
)


_IQM = f"{MOTIONS}_iqm"


def trial_section(finished: FinishedSuite, scenario: ScenarioConfig) -> Section:
    """Motions a reach against trials, and the table of their blocks."""
    measures = (MOTIONS, *map(seconds_at, LOOKS), SUCCESS, RENDEZVOUS)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents_in(scenario))
    costs = trial_costs(with_cost(finished.results, scenario), scenario)
    fine = edges_of(scenario, FINE)
    lines = lines_of(suite.agents)
    agents = suite.agents_in(scenario)
    own = where_it_stands(scenario, "The agents' own trials", suite.worlds)
    figure = trial_curves(
        _title(scenario),
        [
            (each, blocks(costs, each.label, MOTIONS, suite.worlds, fine, cap), lines[each.label])
            for each in agents
        ],
        cap,
        knocks(scenario) or (),
        f"{own} {drawn_in_words(suite.worlds, len(agents))}",
    )
    name = f"{scenario.name}-trials"
    coarse = edges_of(scenario, COARSE)
    band = f"robot seconds per reach, {LOOKS[0]:g} – {LOOKS[-1]:g} s a look"
    columns = ["trials", "agent", "motions per reach", "interquartile mean", band, "success", "rendezvous"]
    rows, summary = [], []
    motions = {label: blocks(costs, label, MOTIONS, suite.worlds, coarse, cap) for label in labels}
    of_agent = {
        label: {
            measure: blocks(costs, label, measure, suite.worlds, coarse, cap).estimates()
            for measure in measures
        }
        | {_IQM: motions[label].estimates(interquartile_mean)}
        for label in labels
    }
    for i, (first, end) in enumerate(pairwise(coarse)):
        for label, found in of_agent.items():
            block, of_block = span(first, end), {measure: each[i] for measure, each in found.items()}
            seconds = [of_block[seconds_at(look)].value for look in (LOOKS[0], LOOKS[-1])]
            rows.append(
                [
                    block,
                    label,
                    number(of_block[MOTIONS], 2),
                    number(of_block[_IQM], 2),
                    " – ".join(f"{each:.1f}" for each in seconds),
                    percent(of_block[SUCCESS], 1),
                    percent(of_block[RENDEZVOUS], 1),
                ]
            )
            summary += [
                summary_row(scenario.name, "by_trial", label, block, measure, each, suite.worlds)
                for measure, each in of_block.items()
            ]
    return Section(
        title=f"Scenario {scenario.name}, trial by trial",
        said=in_words(finished, scenario, MOTIONS, _decisive(scenario, coarse, motions)),
        text=about(suite, scenario),
        figures={name: save(figure, finished.out / "figures", name)},
        table=Table("by_trial", scenario.name, pd.DataFrame(rows, columns=columns)),
        note=_HOW_TO_READ,
        summary=summary,
    )


def _title(scenario: ScenarioConfig) -> str:
    always = [
        again_and_again(scenario),
        *(knock.words for knock in knocks(scenario) or () if not knock.trial),
    ]
    title = f"Motions a reach (a failure counts as {scenario.env.max_episode_steps})"
    return "\n".join([title, *filter(None, always)])


def _decisive(
    scenario: ScenarioConfig, edges: Array, motions: dict[str, Blocks]
) -> dict[str, dict[str, "pd.Series[float]"]]:
    """Each world's motions per reach in the blocks before and after the first event, and in the last one."""
    shown = {len(edges) - 2: "at the end"}
    if events := [event for event in event_trials(scenario) if event > 0]:
        first = int(np.searchsorted(edges, min(events)))
        shown = {first - 1: "before the first perturbation", first: "right after it"} | shown
    return {
        f"{when} (trials {span(edges[i], edges[i + 1])})": {
            label: pd.Series(of_agent.runs[:, i]) for label, of_agent in motions.items()
        }
        for i, when in shown.items()
    }
