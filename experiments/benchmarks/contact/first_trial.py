"""The first trial of an agent that knows nothing yet, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym

import agents
from calfree_gym.geometry import Array


class Trial(NamedTuple):
    """What came of a trial.

    Attributes:
        success: Whether the task is done, by the truth.
        told: Whether images tell so.
        motions: Made.
        truth: At the end, as `info["truth"]` has it.
    """

    success: bool
    told: bool
    motions: int
    truth: Mapping[str, Any]


def first_trial(name: str, env: gym.Env[Any, Any], seed: int, object_: Array | None = None) -> Trial:
    """A fresh agent of a registered name, in the world of a seed.

    Args:
        name: Of the agent.
        env: A task with `is_solved`.
        seed: Of world and agent.
        object_: Where the object is, as `reset` takes it; None: drawn.
    """
    agent = agents.make(name, env, seed=seed)
    observation, info = env.reset(seed=seed, options=None if object_ is None else {"object": object_})
    state, motions, over = None, 0, False
    while not over:
        words, state = agent.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(words)
        motions, over = motions + 1, terminated or truncated
    solved = bool(env.unwrapped.is_solved(info["truth"]))  # type: ignore[attr-defined]
    return Trial(solved, bool(info["is_success"]), motions, info["truth"])
