"""Controllers of the black box, made by name: `agents.make("grid_table", env, cells=8)`.

In the wheel this package is called `calfree_agents`.
"""

from . import moved as _moved  # noqa: F401 (finds modules under their earlier names)
from .base.agent import Agent
from .base.registration import KNOWLEDGE, SERVOS
from .registry import NEURAL, default_settings, learns_by_rewards, make, named, names, tasks

__all__ = [
    "KNOWLEDGE",
    "NEURAL",
    "SERVOS",
    "Agent",
    "default_settings",
    "learns_by_rewards",
    "make",
    "named",
    "names",
    "tasks",
]
