"""What studies share: trials, what becomes of them in tables, and processes side by side."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

import gymnasium as gym
import numpy as np

import agents
import calfree_gym
from calfree_gym.geometry import Array

REACH = calfree_gym.ENV_IDS[0]
DENSE, GRASP = "calfree_gym:CalFree/ReachDense-v0", "calfree_gym:CalFree/Grasp-v0"
CAP = gym.spec(REACH).max_episode_steps or 0
"""Motions as which a trial without a rendezvous counts."""

Map = Callable[..., Iterable[Any]]
"""As `map` with one argument."""


class FirstTrial(NamedTuple):
    """What came of the first trial of an agent that knows nothing: by the truth, and whether images tell so.

    Its infos are those of each motion, its words (motions, m); some agents say that nothing could be done.
    """

    success: bool
    told: bool
    motions: int
    infos: Sequence[Mapping[str, Any]]
    words: Array
    gave_up: bool


def first_trial(agent: Any, env: gym.Env[Any, Any], seed: int, object_: Array | None = None) -> FirstTrial:
    """One trial of a fresh agent, in the world of a seed; the object lies where `reset` takes it."""
    observation, _ = env.reset(seed=seed, options=None if object_ is None else {"object": object_})
    state, over = None, False
    sent, infos = [], []
    while not over:
        words, state = agent.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(words)
        sent.append(words)
        infos.append(info)
        over = terminated or truncated
    solved = bool(env.unwrapped.is_solved(info["truth"]))  # type: ignore[attr-defined]
    gave_up = bool(any(agent.gave_up(state))) if hasattr(agent, "gave_up") else False
    return FirstTrial(solved, bool(info["is_success"]), len(infos), infos, np.array(sent), gave_up)


def first_trials(
    name: str, env: gym.Env[Any, Any], seeds: Iterable[int], **settings: Any
) -> list[FirstTrial]:
    """One in the world of each seed, each by a fresh agent of a registered name."""
    return [first_trial(agents.make(name, env, seed=seed, **settings), env, seed) for seed in seeds]


def arms_of_tests() -> dict[str, dict[str, Any]]:
    """The arms of the tests, which stand in the repository alone: our own, and those of `make arms`."""
    from tests.arms.fetched import fetched_arms
    from tests.arms.own import ARMS

    return {**ARMS, **fetched_arms()}


@contextmanager
def side_by_side(jobs: int | None = None) -> Iterator[Map]:
    """`map` over fresh processes of one thread, one a core or so many; in this process where it is one."""
    jobs = jobs or len(os.sched_getaffinity(0))
    if jobs == 1:
        yield map
        return
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with patch.dict(os.environ, one_thread), multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield pool.imap
