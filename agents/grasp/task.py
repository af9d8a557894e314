"""Which agents do what an environment asks for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from ..base.observation import STANDARD_KEYS
from .inserting.observation import INSERT_WORDS
from .observation import GOAL

TASKS = ("reach", "grasp", "insert")
REACHED = 4
"""Numbers of a goal of reaching: the gripper's sensor vector."""


def task_of(env: gym.Env[Any, Any]) -> str:
    """The task of an environment, one of `TASKS`.

    Goals of grasping also tell whether the object is held, those of inserting how deep the peg is; who
    inserts has no word for jaws.

    Raises:
        ValueError: It is no environment, none of ours, or its observation has no image points.
    """
    space = getattr(env, "observation_space", None)
    if space is None:
        raise ValueError(
            f"it needs an environment, such as gymnasium.make('CalFree/Reach-v0'); found {env!r}"
        )
    spaces = getattr(space, "spaces", None)
    if not isinstance(spaces, Mapping) or "observation" not in spaces:
        raise ValueError(
            f"it needs an environment of calfree_gym; or one with its spaces: this one's observation is "
            f"{space}"
        )
    if missing := [key for key in STANDARD_KEYS if key not in spaces]:
        raise ValueError(
            f"it needs image points ({', '.join(missing)}); this environment's observation has only "
            f"{', '.join(spaces)}; make it with observation='points' or 'vision'"
        )
    goals = spaces["achieved_goal"].shape
    if goals[-1:] not in ((REACHED,), (GOAL,)):
        raise ValueError(
            f"it needs an environment of calfree_gym, or one with its spaces, where achieved_goal has "
            f"{REACHED} or {GOAL} numbers; this environment's has shape {goals}"
        )
    if goals[-1] == REACHED:
        return TASKS[0]
    return TASKS[1 + (env.action_space.shape[-1] == INSERT_WORDS)]  # type: ignore[index]
