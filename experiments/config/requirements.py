"""What an agent requires, so that it is given that and no more, and whether a life fits it."""

from collections.abc import Callable
from contextlib import closing
from typing import Any, NamedTuple

import gymnasium

import agents
from agents.base.prior_knowledge import PriorKnowledge, in_order
from calfree_gym.perturbations import parse_schedule
from experiments.config.environment import EnvironmentConfig
from experiments.config.life import EvaluationConfig, shares, with_shares_as_motions
from experiments.config.suite import AgentConfig, ScenarioConfig


class Requirements(NamedTuple):
    """What an agent must be given.

    Attributes:
        privileged: Observations beside the image points, as the environment's argument `tell` names them.
        settings: Its own, and what its cameras are fixed to, where it uses that and no setting gives it.
        rows: How many arms, of one world, it learns from at once.
        prior_knowledge: What it is built on with these settings, in the order of the vocabulary.
    """

    privileged: tuple[str, ...]
    settings: dict[str, Any]
    rows: int
    prior_knowledge: tuple[PriorKnowledge, ...]


def requirements(agent: AgentConfig, env: EnvironmentConfig) -> Requirements:
    """As `requirements_in`, in an environment that is made for it."""
    with closing(env.make(tell=env.privileged)) as everything:
        return requirements_in(everything, agent, env)


def requirements_in(
    everything: gymnasium.Env[Any, Any], agent: AgentConfig, env: EnvironmentConfig
) -> Requirements:
    """Makes the agent once, in an environment with all privileged observations, to see what it requires.

    Raises:
        ValueError: A setting is not allowed, or it learns from rows where every trial has a world of its own.
    """
    made = agents.make(agent.name, everything, seed=0, **agent.settings)
    mount = {"camera_mount": env.camera_mount} if hasattr(made, "camera_mount") else {}
    if made.rows > 1 and env.redraw != "never":
        raise ValueError(f"it learns from {made.rows} rows in one world; redraw is {env.redraw!r}")
    theirs = [each for each in type(made).__mro__ if each.__module__.partition(".")[0] != "agents"]
    tells = made.prior_knowledge or any("prior_knowledge" in vars(each) for each in theirs)
    known = in_order(made.prior_knowledge if tells or ":" not in agent.name else {PriorKnowledge.UNDECLARED})
    return Requirements(made.privileged, {**mount, **agent.settings}, made.rows, known)


_FAR = 10_000
"""Moves on either side among which the nearest allowed number is sought."""


def unfit_life(
    scenario: ScenarioConfig, agent: AgentConfig, evaluation: EvaluationConfig | None, rows: int
) -> dict[str, str]:
    """What a scenario, with its events and checkpoints, asks in vain of an agent whose arms move together.

    Of such arms, short trials end first: the first trials to end would be no fair sample. By the key below
    the scenario, with the nearest numbers that are allowed; `per_decade` is rounded, and always fits.
    """
    motions = scenario.motions_of(agent)
    if motions is None:
        return {"trials": f"its {rows} arms end trials out of turn: count motions, or set rows: 1"}
    if scenario.places:
        return {"places": f"its {rows} arms end trials out of turn: none has the places in turn; set rows: 1"}
    by_share = dict(shares(scenario.perturbations))

    def fits(life: int) -> bool:
        """Whether its end and all events at shares of it fall on whole moves."""
        return life > 0 and not any(at % rows for at in (life, *(round(s * life) for s in by_share.values())))

    wrong = {}
    if motions % rows:
        wrong["motions"] = f"a life of {motions:,} motions; allowed: {_nearest(motions, rows, fits)}"
    schedule = parse_schedule(list(with_shares_as_motions(scenario.perturbations, motions)))
    for i, event in enumerate(schedule):
        if event.clock != "motion" or event.drift or event.at % rows == 0 or "motions" in wrong:
            continue
        where = f"perturbations.{i}.{'every' if event.every else 'at'}"
        if i in by_share:
            is_at = f"share {by_share[i]:g} of {motions:,} motions is motion {event.at:,}"
            wrong[where] = f"{is_at}; allowed: lives of {_nearest(motions, rows, fits)}"
        else:
            found = f"motion {event.at:,}"
            first = rows if event.every else 0
            near = _nearest(event.at, rows, range(first, motions).__contains__)
            wrong[where] = f"{found}; allowed: {near}"
    every, checkpoints = (evaluation.every, evaluation.at) if evaluation else (None, None)
    if every and every % rows:
        wrong["evaluation.every"] = f"found {every:,}; allowed: {_nearest(every, rows)}"
    if off := next((at for at in checkpoints or () if at % rows), None):
        near = f"{_nearest(off, rows)}, or per_decade, which is rounded up"
        wrong["evaluation.at"] = f"found {off:,}; allowed: {near}"
    return {where: f"its {rows} arms move together: {what}" for where, what in wrong.items()}


def _nearest(motions: int, rows: int, fits: Callable[[int], bool] = lambda each: each > 0) -> str:
    """The nearest multiples of rows below and above that fit."""
    below = motions // rows * rows
    lower = next((each for each in range(below, below - _FAR * rows, -rows) if fits(each)), None)
    higher = next((each for each in range(below + rows, below + _FAR * rows, rows) if fits(each)), None)
    return " or ".join(f"{each:,}" for each in (lower, higher) if each is not None) or "none near"
