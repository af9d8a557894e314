"""Who was best, in sentences made from the numbers: what stands at the head of a report.

An agent is best by its mean over worlds. Another is told apart from it where the 95 % interval of their
paired difference over worlds leaves 0 out; many are compared, and no interval is wider for it. All are
compared in the worlds in which all were scored; where these are few, nobody is best. Nobody ever is who is
told where to go, or who moves at random: they are ceiling and floor.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from experiments.config.suite import AgentConfig, ScenarioConfig, SweepConfig
from experiments.reporting.finished_suite import ENOUGH_WORLDS, MOTIONS, FinishedSuite
from experiments.reporting.tables import counted, number, percent
from experiments.statistics import (
    Estimate,
    mean,
    mean_share,
    over_worlds,
    paired_difference,
    paired_shares,
)

OF_A_CEILING = "object_registers"
"""The privileged observation that tells where to go."""
FLOOR = "random"
"""The kind of agent that knows nothing and learns nothing."""

Scores = Mapping[str, "pd.Series[float]"]
"""By the agent's label: one value a world, by the world's index."""


def in_words(
    finished: FinishedSuite,
    part: ScenarioConfig | SweepConfig,
    measure: str,
    moments: Mapping[str, Scores],
) -> tuple[str, ...]:
    """Who was best at each moment, whom nobody can tell apart from them, and how far ceiling and floor are.

    Args:
        finished: The suite.
        part: Where the scores were made.
        measure: MOTIONS, of which few are good, or a share, of which much is.
        moments: By words such as "at the end": the scores of all agents.
    """
    few, cap = measure == MOTIONS, float(part.env.max_episode_steps)
    beside = {
        agent.label: role for agent in finished.suite.agents_in(part) if (role := _role(finished, agent))
    }
    moments = {when: scores for when, scores in moments.items() if any(map(len, scores.values()))}
    worlds = finished.suite.worlds
    if worlds < ENOUGH_WORLDS:
        points = [f"{_upper(when)}: {_points(scores, few)}." for when, scores in moments.items()]
        head = f"With {counted(worlds, 'world')} no ranking is claimed; means over worlds of {_NAMES[few]}."
        return (head, *points)
    said = []
    for when, scores in moments.items():
        common = set.intersection(*(set(values.index) for values in scores.values()))
        if len(common) < ENOUGH_WORLDS:
            why = f"no ranking: all were scored in {counted(len(common), 'world')} only"
            said.append(f"{_upper(when)}: {_points(scores, few)}; {why}.")
            continue
        scores = {label: values[values.index.isin(common)] for label, values in scores.items()}
        ranked = {label: values for label, values in scores.items() if label not in beside}
        floors = [label for label, role in beside.items() if role == _FLOOR and label in scores]
        if ranked:
            said.append(_best(when, ranked, {label: scores[label] for label in floors}, few, cap))
    if said and (last := [label for label in beside if label in scores]):
        shown = _listed([f"{label}, {beside[label]} ({_shown(scores[label], few, cap)})" for label in last])
        said.append(f"Not ranked, {when}: {shown}.")
    return tuple(said)


_NAMES = {True: "motions a reach", False: "the share of rendezvous"}
_BEST = {True: "needs the fewest motions a reach", False: "has the highest share of rendezvous"}
_CEILING, _FLOOR = "which is told where to go", "the floor"


def _role(finished: FinishedSuite, agent: AgentConfig) -> str:
    """What an agent is compared for, where that is not to win."""
    if agent.name == FLOOR:
        return _FLOOR
    runs = finished.runs_of(agent)
    return _CEILING if runs and OF_A_CEILING in finished.outcomes[runs[0]]["privileged"] else ""


def _best(when: str, ranked: Scores, floors: Scores, few: bool, cap: float) -> str:
    means = {label: float(values.mean()) for label, values in ranked.items()}
    best = (min if few else max)(means, key=lambda label: means[label])
    if means[best] == (cap if few else 0.0):
        return f"{_upper(when)}, no agent reaches."
    first = f"{_upper(when)}, {best} {_BEST[few]}, {_shown(ranked[best], few, cap)}"
    others = {label: values for label, values in ranked.items() if label != best}
    near = [label for label, values in others.items() if not _told_apart(ranked[best], values, few)]
    if floor := [label for label, values in floors.items() if not _told_apart(ranked[best], values, few)]:
        return f"{first}, but cannot be told apart from {_listed(floor)}, the floor."
    if not others:
        return f"{first}."
    if not near:
        return f"{first}; it can be told apart from every other agent."
    if len(near) == len(others):
        return f"{first}, but no other agent can be told apart from it."
    return f"{first}; {_listed(near)} cannot be told apart from it."


def _told_apart(best: "pd.Series[float]", other: "pd.Series[float]", few: bool) -> bool:
    """Whether the interval of the paired difference lies wholly on the side of the best one."""
    both = best.index.intersection(other.index)
    mine, others = best.loc[both].to_numpy(float), other.loc[both].to_numpy(float)
    if few:
        return paired_difference(others, mine).low > 0
    return paired_shares(mine, others, np.random.default_rng(0)).low > 0


def _points(scores: Scores, few: bool) -> str:
    form = "{:.1f}" if few else "{:.0%}"
    points = [f"{label} {form.format(values.mean())}".replace("%", " %") for label, values in scores.items()]
    return ", ".join(points)


def _shown(values: "pd.Series[float]", few: bool, cap: float) -> str:
    return number(_estimate(values, few, cap)) if few else percent(_estimate(values, few, cap))


def _estimate(values: "pd.Series[float]", few: bool, cap: float) -> Estimate:
    found, rng = values.to_numpy(float), np.random.default_rng(0)
    return over_worlds(found, mean, (1.0, cap), rng) if few else mean_share(found, rng)


def _listed(words: Sequence[str]) -> str:
    """As "a, b and c"."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _upper(words: str) -> str:
    return words[0].upper() + words[1:]
