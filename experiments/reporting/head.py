"""What a suite comes to in a minute: its one table, and at most three sentences made from its numbers.

Who is told where to go and who moves at random are ceiling and floor, and not compared. Who is in fewer than
20 worlds is not ranked; where nearly all are, it is only said how far agents lie apart.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import pandas as pd

from experiments.config.in_words import knocks, later_knocks
from experiments.config.life import EvaluationConfig
from experiments.config.suite import AgentConfig, ScenarioConfig, SweepConfig
from experiments.reporting.by_trial import COARSE, OwnTrials, edges_of, span
from experiments.reporting.figures import in_words
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, FinishedSuite
from experiments.reporting.held_out import (
    AFTER,
    AT_THE_END,
    BEFORE,
    BEGINNING,
    GOOD,
    RIGHT_AFTER,
    HeldOut,
    HeldOutMoment,
    Times,
    common_worlds,
)
from experiments.reporting.sweep import Swept
from experiments.reporting.tables import NOTHING, Table, counted, written
from experiments.statistics import ENOUGH_WORLDS, paired_motions

_KNOWN_IN_WORDS = {
    "`object_registers`": "where to go",
    "`joint_angles`": "its joint angles",
    "`joint_zeros`": "where its joints have their zeros",
    "`gripper_position`": "where its gripper is in the room",
    "`pose`": "where it stands",
    "`wheels`": "what its wheels do",
    "image scale": "image size",
    "camera model": "how cameras project",
    "arm": "its arm",
    "chain of joints": "that its arm is a chain",
    "flat floor": "that the floor is flat",
    "mount": "where cameras stand",
    "reward": "a reward",
    "word limit": "motor strength",
    "training worlds": "worlds to train in",
}
"""Privileged observations, and prior knowledge."""
_GOOD = written(GOOD, ".0%")
_OF_A_CEILING = "object_registers"
"""The privileged observation that tells where to go."""
_FLOOR = "random"
"""The kind of agent that knows nothing and learns nothing."""
_WHEN = {BEFORE: "Before the knock", AT_THE_END: "At the end"}
_Cells = dict[str, dict[str, str]]
"""By the agent's label and the column."""


def table_of(
    finished: FinishedSuite, part: ScenarioConfig | SweepConfig, come_to: HeldOut | OwnTrials | Swept
) -> Table:
    """A scenario or sweep in at most five columns, without intervals; agents in words, in the suite's order.

    With held-out trials: motions per reach before and right after the first change, or at the end where there
    is none, how many trials reach then, and the motions lived before it reaches. Else the first and the last
    trials, or values; trials before and after the first change, too.
    """
    if isinstance(come_to, HeldOut):
        evaluation = finished.suite.evaluation_of(come_to.scenario)
        assert evaluation is not None, "there are held-out trials"
        found, note = _of_held_out(come_to, evaluation)
    elif isinstance(come_to, OwnTrials):
        found, note = _of_trials(come_to)
    else:
        found, note = _of_sweep(come_to)
    rows = [
        {
            "agent": in_words(agent.label, agent.name),
            "what it must know": ", ".join(
                _KNOWN_IN_WORDS.get(each, each) for each in finished.must_know(agent).split(", ")
            ),
            **found[agent.label],
        }
        for agent in finished.suite.agents_in(part)
    ]
    return Table(part.name, f"{finished.suite.name}: {part.name}", pd.DataFrame(rows), note=note)


def _of_held_out(held: HeldOut, evaluation: EvaluationConfig) -> tuple[_Cells, str]:
    changes = held.scenario.is_knocked
    shown = (BEFORE, RIGHT_AFTER) if changes else (AT_THE_END,)
    column = f"motions per reach {' → '.join(shown)}{' the knock' * changes}"
    until_good = f"motions until {_GOOD} of trials reach{' → again after it' * changes}"
    found = {}
    for label, moments in held.moments.items():
        motions = [_motions(moments[each].motions.value) if each in moments else NOTHING for each in shown]
        last = moments.get(shown[-1])
        share = written(last.rendezvous.value, ".0%") if last else NOTHING
        if last and len(last.worlds) < held.worlds[label]:
            share += f" in {len(last.worlds)} of {held.worlds[label]} worlds"
        until = [_until(held.times[label].get(stretch)) for stretch in (BEGINNING, AFTER)[: 1 + changes]]
        found[label] = {
            column: " → ".join(motions),
            f"trials that reach {shown[-1]}": share,
            until_good: " → ".join(until),
        }
    met = later_knocks(held.scenario)
    knock = f" The knock: {met[0].words}." if met else ""
    steps = evaluation.per_decade
    apart = f"; checkpoints are {10 ** (1 / steps):.1f}-fold apart" if steps else ""
    return found, (
        "Motions: of the median world, shares of all, in test trials, which teach nothing; a failed one "
        f"counts as {held.cap}. {_GOOD}: of {evaluation.trials} test trials, and of all later ones, as "
        f"cameras see it{apart}.{knock}"
    )


def _until(times: Times | None) -> str:
    if times is None:
        return NOTHING
    median = times.median.value
    return f"not in {times.latest:,.0f}" if math.isinf(median) else f"{median:,.0f}"


def _of_trials(own: OwnTrials) -> tuple[_Cells, str]:
    edges = edges_of(own.scenario, (1, *COARSE))
    blocks = list(pairwise(edges))
    knock = next((each for each in knocks(own.scenario) or () if each.trial), None)
    after = [first for first, _ in blocks].index(knock.trial) if knock else 0
    shown = sorted({max(after - 1, 0), after, len(blocks) - 1})
    column = f"motions per reach in trials {' → '.join(span(*blocks[each]) for each in shown)}"
    found = {}
    for label in own.worlds:
        of_blocks = own.blocks(label, MOTIONS, edges).estimates()
        found[label] = {column: " → ".join(_motions(of_blocks[each].value) for each in shown)}
    note = f"Of the median world, in the agents' own trials; one that fails counts as {own.cap} motions."
    return found, note + (f" {knock.when.capitalize()}: {knock.words}." if knock else "")


def _of_sweep(found: Swept) -> tuple[_Cells, str]:
    over = found.sweep.over
    ends = (0, -1)[: len(over)]
    column = f"{RENDEZVOUS} at {found.sweep.vary} {' → '.join(f'{over[i]:g}' for i in ends)}"
    cells = {}
    for label, curve in found.points.items():
        shares = (written(curve[i].rendezvous.value, ".0%") or NOTHING for i in ends)
        cells[label] = {column: " → ".join(shares)}
    return cells, "Share of trials that end with an observed rendezvous; one trial a world, without learning."


def _motions(found: float) -> str:
    return NOTHING if math.isnan(found) else f"{found:,.1f}"


def sentences(finished: FinishedSuite, held: HeldOut) -> list[str]:
    """At most three: who needs the fewest motions, what the first change costs, and who reaches again."""
    scenario = held.scenario
    agents = [each for each in finished.suite.agents_in(scenario) if not _aside(finished, each)]
    changed = any(BEFORE in held.moments[each.label] for each in agents)
    when, until = (BEFORE, AFTER) if changed else (AT_THE_END, BEGINNING)
    agents = [each for each in agents if when in held.moments[each.label]]
    ranked = [each for each in agents if len(held.moments[each.label][when].worlds) >= ENOUGH_WORLDS]
    few = len(ranked) < min(2, len(agents))
    agents = agents if few else ranked
    found = {in_words(each.label, each.name): held.moments[each.label] for each in agents}
    medians = {
        in_words(each.label, each.name): times.median.value
        for each in agents
        if (times := held.times[each.label].get(until))
    }
    said = [_fewest({words: of[when] for words, of in found.items()}, _WHEN[when], few)]
    if not few:
        said += [_cost(found) if changed else "", _again(medians, changed)]
    return [sentence for sentence in said if sentence]


def _aside(finished: FinishedSuite, agent: AgentConfig) -> bool:
    """Whether an agent is compared for another purpose than to win."""
    outcome = finished.outcome_of(agent)
    return agent.name == _FLOOR or (outcome is not None and _OF_A_CEILING in outcome["privileged"])


def _fewest(found: Mapping[str, HeldOutMoment], when: str, few: bool) -> str:
    """Who needs the fewest motions, and who cannot be told apart from it."""
    if not found:
        return ""
    motions = {words: moment.motions.value for words, moment in found.items()}
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


def _told_apart(best: HeldOutMoment, other: HeldOutMoment) -> bool:
    """Whether the interval of the difference, in the worlds of both, leaves out 0."""
    both = common_worlds(best, other)
    return paired_motions(other.worlds.loc[both, MOTIONS], best.worlds.loc[both, MOTIONS]).low > 0


def _cost(found: Mapping[str, Mapping[str, HeldOutMoment]]) -> str:
    """For whom the first change costs most, and least."""
    both = {
        words: (of[BEFORE].motions.value, of[RIGHT_AFTER].motions.value)
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
    parts = []
    if reached:
        first = [each for each in reached if medians[each] == medians[reached[0]]]
        again = " again" if changed else ""
        reach = f"{listed(first)} first reach{'es' * (len(first) == 1)} in {_GOOD} of trials{again}"
        parts.append(f"{reach}, {_within(medians[first[0]])}")
        if len(first) < len(reached):
            parts.append(f"{reached[-1]} last, {_within(medians[reached[-1]])}")
    if never:
        parts.append(f"{listed(never)} do{'es' * (len(never) == 1)} not in the time that was given")
    if not parts:
        return ""
    when = "After it, " if changed else "From the beginning, "
    return f"{when}{'; '.join(parts)}."


def _within(motions: float) -> str:
    return f"within {counted(round(motions), 'motion')}" if motions else "at once"


def listed(words: Sequence[str]) -> str:
    """As "a, b and c"."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last
