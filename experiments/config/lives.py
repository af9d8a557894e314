"""Whether agents' lives, which may have different lengths, come to all that their scenarios name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from experiments.config.schedule import check_reached, with_shares_as_motions

if TYPE_CHECKING:
    from experiments.config.evaluation import EvaluationConfig
    from experiments.config.suite import AgentConfig, ScenarioConfig


def check_events(
    schedule: Sequence[dict[str, Any]], motions: int | None, trials: int | None, of: str = "a lifetime of "
) -> None:
    """Raises ValueError where a schedule is wrong, or an event is never reached in a life of this length."""
    check_reached(with_shares_as_motions(schedule, motions), {"motion": motions, "trial": trials}, of)


def check_lives(
    agents: Sequence[AgentConfig], scenarios: Sequence[ScenarioConfig], evaluation: EvaluationConfig | None
) -> None:
    """Raises where a life of its own leads an agent nowhere, or a checkpoint is after all lives.

    Args:
        agents: All of a suite.
        scenarios: All of it.
        evaluation: Where a scenario has none of its own.

    Raises:
        ValueError: Names the agent or the checkpoint.
    """
    longest = {each.name: each.most_motions for each in scenarios if each.agents is None}
    for i, agent in enumerate(agents):
        mine = [each for each in scenarios if each.agents is None or agent.label in each.agents]
        if agent.motions and not any(each.motions for each in mine):
            raise ValueError(
                f"agents.{i}.motions is {agent.motions}, and {agent.label!r} is in no scenario that is "
                "counted in motions"
            )
        for each in mine:
            motions = each.motions_of(agent)
            longest[each.name] = max(longest.get(each.name, 0), motions or each.most_motions)
            if agent.motions and motions:
                of = f"the life that {agent.label!r} has in {each.name!r}, of "
                check_events(each.perturbations, motions, None, of)
    for each in scenarios:
        when = each.evaluation or evaluation
        last = when.at[-1] if when and when.at else 0
        if last > (most := longest.get(each.name, 0)):
            raise ValueError(f"evaluation.at has {last}; lives in {each.name!r} have at most {most} motions")
