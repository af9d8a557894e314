"""What a comparison comes to, in sentences made from its numbers.

Who is told where to go and who moves at random are ceiling and floor, and not compared. Where an agent is in
fewer than 20 worlds nobody is ranked: then it is said how far agents lie apart.
"""

import math
from collections.abc import Mapping, Sequence

from experiments.config.suite import AgentConfig, ScenarioConfig
from experiments.reporting.agents_in_words import in_words
from experiments.reporting.finished_suite import (
    ENOUGH_WORLDS,
    MOTIONS,
    FinishedSuite,
    with_cost,
    worlds_of,
)
from experiments.reporting.held_out.comparison import common_worlds
from experiments.reporting.held_out.estimates import AT_THE_END, BEFORE, RIGHT_AFTER, Moment, moments
from experiments.reporting.held_out.thresholds import AFTER, BEGINNING, GOOD, times_to_good
from experiments.reporting.tables import counted
from experiments.statistics import median_time, paired_motions

OF_A_CEILING = "object_registers"
"""The privileged observation that tells where to go."""
FLOOR = "random"
"""The kind of agent that knows nothing and learns nothing."""


def sentences(finished: FinishedSuite, scenario: ScenarioConfig) -> list[str]:
    """At most three: who needs the fewest motions, what the first change costs, and who reaches again.

    Args:
        finished: The suite.
        scenario: One with held-out trials.
    """
    rows, cap = with_cost(finished.results, scenario), scenario.env.max_episode_steps
    agents = [each for each in finished.suite.agents_in(scenario) if not _aside(finished, each)]
    found = {
        in_words(each.label, each.name): moments(rows, each.label, worlds_of(finished.suite, each.label), cap)
        for each in agents
    }
    times = {
        in_words(each.label, each.name): times_to_good(
            rows, each.label, worlds_of(finished.suite, each.label)
        )
        for each in agents
    }
    changed = any(BEFORE in of_agent for of_agent in found.values())
    when, until = (BEFORE, AFTER) if changed else (AT_THE_END, BEGINNING)
    medians = {
        words: median_time(at, good).value
        for words, of_agent in times.items()
        if until in of_agent
        for at, good, _ in (of_agent[until],)
    }
    few = finished.fewest_worlds(scenario) < ENOUGH_WORLDS
    said = [
        _fewest({words: of[when] for words, of in found.items() if when in of}, _WHEN[when], few),
        _cost(found) if changed else "",
        _again(medians, changed),
    ]
    return [sentence for sentence in said if sentence]


_WHEN = {BEFORE: "Before the knock", AT_THE_END: "At the end"}


def _aside(finished: FinishedSuite, agent: AgentConfig) -> bool:
    """Whether an agent is compared for another purpose than to win."""
    outcome = finished.outcome_of(agent)
    return agent.name == FLOOR or (outcome is not None and OF_A_CEILING in outcome["privileged"])


def _fewest(found: Mapping[str, Moment], when: str, few: bool) -> str:
    """Who needs the fewest motions, and who cannot be told apart from it."""
    if not found:
        return ""
    motions = {words: moment.motions().value for words, moment in found.items()}
    best, worst = min(motions, key=motions.__getitem__), max(motions, key=motions.__getitem__)
    if few or len(found) == 1:
        worlds = counted(min(len(moment.worlds) for moment in found.values()), "world")
        return (
            f"{when}, the median world needs {motions[best]:.1f} ({best}) to {motions[worst]:.1f} "
            f"({worst}) motions per reach; {worlds} {'is' if worlds == '1 world' else 'are'} too few to rank "
            "anybody."
        )
    others = {words: moment for words, moment in found.items() if words != best}
    near = [words for words, moment in others.items() if not _told_apart(found[best], moment)]
    first = f"{when}, {best} needs the fewest motions per reach, {motions[best]:.1f} in the median world"
    if len(near) == len(others):
        return f"{first}, but no other agent can be told apart from it."
    return f"{first}; {listed(near)} cannot be told apart from it." if near else f"{first}."


def _told_apart(best: Moment, other: Moment) -> bool:
    """Whether the interval of the difference, in the worlds of both, leaves out 0."""
    both = common_worlds(best, other)
    return paired_motions(other.worlds.loc[both, MOTIONS], best.worlds.loc[both, MOTIONS]).low > 0


def _cost(found: Mapping[str, Mapping[str, Moment]]) -> str:
    """For whom the first change costs most, and least."""
    both = {
        words: (of[BEFORE].motions().value, of[RIGHT_AFTER].motions().value)
        for words, of in found.items()
        if BEFORE in of and RIGHT_AFTER in of
    }
    ranked = sorted(both, key=lambda words: both[words][1] - both[words][0])
    if len(ranked) < 2:
        return ""
    least, most = (f"{both[words][0]:.1f} → {both[words][1]:.1f}" for words in (ranked[0], ranked[-1]))
    return (
        f"Right after it, {ranked[-1]} loses most ({most} motions per reach) and {ranked[0]} least ({least})."
    )


def _again(medians: Mapping[str, float], changed: bool) -> str:
    """Who comes to the threshold first and last, and who never does."""
    reached = sorted((each for each in medians if math.isfinite(medians[each])), key=medians.__getitem__)
    never = [each for each in medians if math.isinf(medians[each])]
    share = f"{GOOD:.0%}".replace("%", " %")
    parts = []
    if reached:
        first = [each for each in reached if medians[each] == medians[reached[0]]]
        again = " again" if changed else ""
        reach = f"{listed(first)} first {_verb('reach', first)} in {share} of trials{again}"
        parts.append(f"{reach}, {_within(medians[first[0]])}")
        if len(first) < len(reached):
            parts.append(f"{reached[-1]} last, {_within(medians[reached[-1]])}")
    if never:
        parts.append(f"{listed(never)} {_verb('do', never)} not in the time that was given")
    if not parts:
        return ""
    when = "After it, " if changed else "From the beginning, "
    return f"{when}{'; '.join(parts)}."


def _within(motions: float) -> str:
    return f"within {counted(round(motions), 'motion')}" if motions else "at once"


def _verb(verb: str, subjects: Sequence[str]) -> str:
    return verb if len(subjects) > 1 else {"do": "does"}.get(verb, f"{verb}es")


def listed(words: Sequence[str]) -> str:
    """As "a, b and c"."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last
