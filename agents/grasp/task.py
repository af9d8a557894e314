"""Which agents do what an environment asks for."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from .inserting.observation import WORDS as OF_INSERTING
from .observation import GOAL

TASKS = ("reach", "grasp", "insert")


def task_of(env: gym.Env[Any, Any]) -> str:
    """The task of an environment, one of `TASKS`.

    Goals of grasping also tell whether the object is held, those of inserting how deep the peg is; who
    inserts has no word for jaws.
    """
    goals = getattr(env.observation_space, "spaces", {}).get("achieved_goal")
    if goals is None or goals.shape[-1] != GOAL:
        return TASKS[0]
    return TASKS[1 + (env.action_space.shape[-1] == OF_INSERTING)]  # type: ignore[index]
