"""The part of the report about a scenario whose lifetimes are counted in trials."""

from itertools import pairwise

import pandas as pd

from experiments.config.suite import ScenarioConfig
from experiments.reporting.agents_in_words import lines_of
from experiments.reporting.by_trial.estimates import (
    COARSE,
    FINE,
    LOOKS,
    blocks,
    edges_of,
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
    worlds_of,
)
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.pages.perturbations_in_words import again_and_again, knocks
from experiments.reporting.pages.style import drawn_in_words, save
from experiments.reporting.tables import Table, number, percent, with_most
from experiments.statistics import most_worlds

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


def trial_section(finished: FinishedSuite, scenario: ScenarioConfig) -> Section:
    """Motions per reach against trials, and the table of their blocks."""
    measures = (MOTIONS, *map(seconds_at, LOOKS), SUCCESS, RENDEZVOUS)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents_in(scenario))
    costs = trial_costs(with_cost(finished.results, scenario), scenario)
    fine = edges_of(scenario, FINE)
    of, agents = lines_of(suite.agents), suite.agents_in(scenario)
    worlds = [worlds_of(suite, label) for label in labels]
    own = where_it_stands(scenario, "The agents' own trials", *worlds)
    figure = trial_curves(
        _title(scenario),
        [
            (each, blocks(costs, each.label, MOTIONS, amount, fine, cap), of[each.label])
            for each, amount in zip(agents, worlds, strict=True)
        ],
        cap,
        knocks(scenario) or (),
        f"{own} {drawn_in_words(min(worlds), len(agents))}",
    )
    name = f"{scenario.name}-trials"
    coarse = edges_of(scenario, COARSE)
    of_agent = {
        label: {
            measure: blocks(costs, label, measure, worlds_of(suite, label), coarse, cap)
            for measure in measures
        }
        for label in labels
    }
    estimates = {
        label: {measure: each.estimates() for measure, each in of_blocks.items()}
        for label, of_blocks in of_agent.items()
    }
    lines, intervals, summary = [], [], []
    for i, (first, end) in enumerate(pairwise(coarse)):
        for label, of_blocks in of_agent.items():
            block, motions = span(first, end), of_blocks[MOTIONS].runs[:, i]
            found = {measure: each[i] for measure, each in estimates[label].items()}
            seconds = [found[seconds_at(look)].value for look in (LOOKS[0], LOOKS[-1])]
            lines.append(
                [
                    block,
                    label,
                    with_most(found[MOTIONS].value, most_worlds(motions), ".1f"),
                    " – ".join(f"{each:,.0f}" for each in seconds),
                    f"{found[RENDEZVOUS].value:.1%}".replace("%", " %"),
                ]
            )
            shares = (percent(found[share], 1) for share in (RENDEZVOUS, SUCCESS))
            intervals.append([block, label, number(found[MOTIONS], 2), *shares])
            summary += [
                summary_row(scenario.name, "by_trial", label, block, measure, each, len(motions))
                for measure, each in found.items()
            ]
    band = f"robot seconds, {LOOKS[0]:g} – {LOOKS[-1]:g} s a look"
    shown = pd.DataFrame(lines, columns=["trials", "agent", "motions per reach", band, "rendezvous"])
    detailed = pd.DataFrame(
        intervals, columns=["trials", "agent", "motions per reach", "rendezvous", "success"]
    )
    return Section(
        title=f"{scenario.name}: trial by trial",
        text=about(finished, scenario),
        figures={name: save(figure, finished.out / "figures", name)},
        tables=(
            Table(f"{scenario.name}-trials", f"{scenario.name}, trial by trial", shown),
            Table(f"{scenario.name}-trials-intervals", f"{scenario.name}, with intervals", detailed),
        ),
        note=_HOW_TO_READ,
        summary=summary,
    )


def _title(scenario: ScenarioConfig) -> str:
    always = [
        again_and_again(scenario),
        *(knock.words for knock in knocks(scenario) or () if not knock.trial),
    ]
    title = f"Motions per reach (a failure counts as {scenario.env.max_episode_steps})"
    return "\n".join([title, *filter(None, always)])
