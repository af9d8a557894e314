"""First trials of agents that know nothing yet, and what came of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import agents
from calfree_gym.geometry import Array
from experiments.reporting.tables import beside
from experiments.statistics import mean_share


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


def first_trials(name: str, env: gym.Env[Any, Any], seeds: range) -> list[Trial]:
    """One in the world of each seed, each by a fresh agent; the environment is closed."""
    trials = [first_trial(name, env, seed) for seed in seeds]
    env.close()
    return trials


def success_of(trials: Sequence[Trial]) -> dict[str, Any]:
    """Columns of a table: the share of successes, and its interval over worlds."""
    found = np.array([[trial.success] for trial in trials])
    return beside("success", mean_share(found), ".0%")
