"""What an agent requires, so that it is given that and no more."""

from typing import Any, NamedTuple

import agents
from calfree_gym.envs.goal import PRIVILEGED
from experiments.config.suite import AgentConfig, EnvironmentConfig


class Requirements(NamedTuple):
    """What an agent must be given.

    Attributes:
        privileged: Observations beside the image points, as the environment's argument `tell` names them.
        settings: Its own, and what its cameras are fixed to, where it uses that and no setting gives it.
    """

    privileged: tuple[str, ...]
    settings: dict[str, Any]


def requirements(agent: AgentConfig, env: EnvironmentConfig) -> Requirements:
    """Makes the agent once, in an environment with all privileged observations, to see what it requires.

    Raises:
        ValueError: A setting is not allowed.
    """
    everything = env.make(tell=tuple(PRIVILEGED))
    made = agents.make(agent.name, everything, seed=0, **agent.settings)
    everything.close()
    mount = {"camera_mount": env.camera_mount} if hasattr(made, "camera_mount") else {}
    return Requirements(made.privileged, {**mount, **agent.settings})
