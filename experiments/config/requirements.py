"""What an agent requires, so that it is given that and no more."""

from typing import Any, NamedTuple

import agents
from agents.base.prior_knowledge import PriorKnowledge, in_order
from calfree_gym.tasks.reach import PRIVILEGED
from experiments.config.environment import EnvironmentConfig
from experiments.config.suite import AgentConfig


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
    """Makes the agent once, in an environment with all privileged observations, to see what it requires.

    Raises:
        ValueError: A setting is not allowed, or it learns from rows where every trial has a world of its own.
    """
    everything = env.make(tell=tuple(PRIVILEGED))
    made = agents.make(agent.name, everything, seed=0, **agent.settings)
    everything.close()
    mount = {"camera_mount": env.camera_mount} if hasattr(made, "camera_mount") else {}
    if made.rows > 1 and env.redraw != "never":
        raise ValueError(f"it learns from {made.rows} rows in one world; redraw is {env.redraw!r}")
    known = in_order(made.prior_knowledge)
    return Requirements(made.privileged, {**mount, **agent.settings}, made.rows, known)
