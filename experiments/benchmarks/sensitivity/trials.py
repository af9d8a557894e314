"""What a constant is tried in: first trials, later ones, trouble, lifetimes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import agents
import calfree_gym
from calfree_gym.world import World
from experiments.benchmarks.sensitivity.constants import Constant, varied
from experiments.evaluation import TrialRecord, evaluate
from experiments.running.lifetime import LifetimeRecorder, learn_trials

Array = NDArray[np.float64]

REACH = calfree_gym.ENV_IDS[0]
CAP = 60
"""Motions of a trial that failed."""
NEAR_PX = 8
"""In trouble a trial succeeds where the true error comes within this: noise of 3 px hides a smaller one."""
MISTAKEN = [
    {"at": {"trial": 0}, "do": {"type": "point_outliers", "share": 0.2}},
    {"at": {"trial": 0}, "do": {"type": "point_noise", "px": 3.0}},
]
LATE = [
    {"at": {"trial": 0}, "do": {"type": "latency", "motions": 1}},
    {"at": {"trial": 0}, "do": {"type": "point_dropout", "share": 0.2}},
]


@dataclass(frozen=True)
class Sizes:
    """How many trials are made by each variation in each world.

    Attributes:
        first: First trials, each by a fresh agent.
        later: Trials after a first one, by an agent that learns.
        trouble: First trials with mistaken and noisy points, and as many with late and missing ones.
        lifetime: Trials of a lifetime, in which a camera is re-aimed half way and replaced at three quarters.
    """

    first: int = 8
    later: int = 8
    trouble: int = 8
    lifetime: int = 40


@dataclass(frozen=True)
class Variation:
    """A constant with another value; the base where there is none."""

    constant: Constant | None = None
    value: float = 0.0


@dataclass(frozen=True)
class Task:
    """All variations of an agent under one condition in one world."""

    agent: str
    condition: str
    seed: int
    mount: str
    sizes: Sizes
    variations: tuple[Variation, ...]


def _first(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    """First trials, each by an agent that knows nothing."""
    agent = agents.make(task.agent, env, **settings)
    return _scored(evaluate(agent, env, task.sizes.first, task.seed))


def _later(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    return _scored(_lifetime(task, env, settings, 1 + task.sizes.later)[1:])


def _whole(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    return _scored(_lifetime(task, env, settings, task.sizes.lifetime))


def _trouble(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    """First trials until the true error is small: in noise an observed one is small by luck."""
    agent = agents.make(task.agent, env, **settings)
    records = evaluate(agent, EndsNear(env), task.sizes.trouble, task.seed)
    return np.array([(each.motions, each.motions_to[NEAR_PX] is not None) for each in records], float)


class EndsNear(gym.Wrapper[Any, Any, Any, Any]):
    """Ends a trial where gripper and object truly are within `NEAR_PX`."""

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Makes one motion."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        near = bool(info["truth"]["error_px"] <= NEAR_PX)
        return observation, reward, terminated or near, truncated, info


def _lifetime(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any], trials: int) -> list[TrialRecord]:
    recorder = LifetimeRecorder(env, task.seed)
    return learn_trials(agents.make(task.agent, recorder, **settings), recorder, trials)


def _scored(records: list[TrialRecord]) -> Array:
    """Motions and success of each trial (trials, 2)."""
    return np.array([(each.motions_per_reach(CAP), each.success) for each in records], float)


def _clear(sizes: Sizes) -> dict[str, Any]:
    return {}


def _mistaken(sizes: Sizes) -> dict[str, Any]:
    return {"perturbations": MISTAKEN, "terminate_on_success": False}


def _late(sizes: Sizes) -> dict[str, Any]:
    return {"perturbations": LATE, "terminate_on_success": False}


def _changed_cameras(sizes: Sizes) -> dict[str, Any]:
    camera = {"camera": "left"}
    aim = {"at": {"trial": sizes.lifetime // 2}, "do": {"type": "camera_aim", "degrees": 10, **camera}}
    replace = {"at": {"trial": 3 * sizes.lifetime // 4}, "do": {"type": "camera_replace", **camera}}
    return {"perturbations": [aim, replace]}


CONDITIONS: dict[str, dict[str, tuple[Callable[..., Array], Callable[[Sizes], dict[str, Any]]]]] = {
    "unified_servo": {
        "first trials": (_first, _clear),
        "later trials": (_later, _clear),
        "mistaken points": (_trouble, _mistaken),
        "late points": (_trouble, _late),
    },
    "memory": {"changed cameras": (_whole, _changed_cameras)},
}
"""What each agent is measured in: how, and in which environments."""


@cache
def _world(seed: int, mount: str) -> World:
    env: Any = gym.make(REACH, camera_mount=mount, dynamics="kinematic")
    env.reset(seed=seed)
    return env.unwrapped.world


def carry_out(task: Task) -> tuple[Task, Array]:
    """A task, and its motions and success (variations, trials, 2); NaN where an error was raised."""
    measure, options = CONDITIONS[task.agent][task.condition]
    env = gym.make(
        REACH,
        world=_world(task.seed, task.mount),
        camera_mount=task.mount,
        dynamics="kinematic",
        max_episode_steps=CAP,
        **options(task.sizes),
    )
    found: list[Array] = []
    for variation in task.variations:
        try:
            with varied(variation.constant, variation.value) as settings:
                found.append(measure(task, env, settings))
        except (ArithmeticError, ValueError, LookupError):
            if variation.constant is None:
                raise
            found.append(np.full_like(found[0], np.nan))
    return task, np.array(found)
