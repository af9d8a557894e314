"""What an agent asks for, so that it is given that and no more."""

from typing import Any, NamedTuple

import agents
from calfree_gym.envs.goal import PRIVILEGED
from experiments.config.suite import AgentConfig, EnvironmentConfig


class Asked(NamedTuple):
    """What an agent must be given.

    Attributes:
        tell: What its environment must tell it beside the image points.
        settings: Its own, and what its cameras are fixed to, where it goes by that and is not told otherwise.
    """

    tell: tuple[str, ...]
    settings: dict[str, Any]


def asked(agent: AgentConfig, env: EnvironmentConfig) -> Asked:
    """Makes the agent once, where all is told, to see what it asks for.

    Raises:
        ValueError: A setting is not allowed.
    """
    telling = env.make(tell=tuple(PRIVILEGED))
    made = agents.make(agent.name, telling, seed=0, **agent.settings)
    telling.close()
    mount = {"camera_mount": env.camera_mount} if hasattr(made, "camera_mount") else {}
    return Asked(made.told, {**mount, **agent.settings})
