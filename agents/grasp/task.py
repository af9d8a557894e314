"""Which agents do what an environment asks for."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from .observation import GOAL

TASKS = ("reach", "grasp")


def task_of(env: gym.Env[Any, Any]) -> str:
    """The task of an environment, one of `TASKS`: goals of grasping also tell whether the object is held."""
    goals = getattr(env.observation_space, "spaces", {}).get("achieved_goal")
    return TASKS[goals is not None and goals.shape[-1] == GOAL]
