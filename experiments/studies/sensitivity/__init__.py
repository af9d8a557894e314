"""Which constants matter: each one halved and doubled, in wild worlds that nobody tuned on.

Nothing is changed by what is found: a table lists it. Base and variations meet the same worlds, objects and
noise, so that differences are paired.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from numpy.typing import NDArray

import agents
from calfree_gym import MOUNTS
from calfree_gym.world import World
from experiments.evaluation import TrialRecord, evaluate
from experiments.reporting.tables import Table
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import Estimate, mean_estimate, relative_change
from experiments.studies.common import CAP, REACH, side_by_side
from experiments.studies.sensitivity.constants import MODULES, Constant, constants_of, varied

Array = NDArray[np.float64]

FIRST_WORLD = 5000
"""`unified_servo` and `memory` were not tuned on worlds from here on; the study `priors` uses them, too."""
FACTORS = (0.5, 2.0)
MOTIONS, SUCCESS = 0.05, 0.01
"""Changes of motions (a share) and of success (one point) that are too small to matter."""
NEAR_PX = 8
"""In trouble a trial succeeds where the true error comes within this: noise of 3 px hides a smaller one."""


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


# -- What a constant is tried in


def _first(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    """First trials, each by an agent that knows nothing."""
    agent = agents.make(task.agent, env, **settings)
    return _scored(evaluate(agent, env, task.sizes.first, task.seed))


def _later(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    """Trials after a first one."""
    return _lifetime(task, env, settings, 1 + task.sizes.later)[1:]


def _whole(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    """All trials of a life."""
    return _lifetime(task, env, settings, task.sizes.lifetime)


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


def _lifetime(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any], trials: int) -> Array:
    recorder = LifetimeRecorder(env, task.seed)
    return _scored(learn_trials(agents.make(task.agent, recorder, **settings), recorder, trials))


def _scored(records: list[TrialRecord]) -> Array:
    """Motions and success of each trial (trials, 2)."""
    return np.array([(each.motions_per_reach(CAP), each.success) for each in records], float)


def _from_the_start(*changes: dict[str, Any]) -> Callable[[Sizes], dict[str, Any]]:
    """Arguments of an environment that is in trouble, and ends no trial by an observed rendezvous."""
    schedule = [{"at": {"trial": 0}, "do": change} for change in changes]
    return lambda sizes: {"perturbations": schedule, "terminate_on_success": False}


def _changed_cameras(sizes: Sizes) -> dict[str, Any]:
    aim = {"type": "camera_aim", "degrees": 10, "camera": "left"}
    replace = {"type": "camera_replace", "camera": "left"}
    half, three_quarters = sizes.lifetime // 2, 3 * sizes.lifetime // 4
    schedule = [{"at": {"trial": half}, "do": aim}, {"at": {"trial": three_quarters}, "do": replace}]
    return {"perturbations": schedule}


_mistaken = _from_the_start({"type": "point_outliers", "share": 0.2}, {"type": "point_noise", "px": 3.0})
_late = _from_the_start({"type": "latency", "motions": 1}, {"type": "point_dropout", "share": 0.2})
CONDITIONS: dict[str, dict[str, tuple[Callable[..., Array], Callable[[Sizes], dict[str, Any]]]]] = {
    "unified_servo": {
        "first trials": (_first, lambda sizes: {}),
        "later trials": (_later, lambda sizes: {}),
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


def carry_out(task: Task) -> Array:
    """Motions and success of a task's trials (variations, trials, 2); NaN where an error was raised."""
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
    return np.array(found)


# -- What comes of it


def tables(worlds: int = 20, sizes: Sizes | None = None, only: Collection[str] = ()) -> Iterator[Table]:
    """The table of `sensitivity`, for people."""
    sizes = sizes or Sizes()
    short = "" if worlds >= 20 else " A short run, which only shows what the table looks like."
    yield Table(
        "constants",
        "Each constant of unified_servo and memory, halved and doubled",
        readable(sensitivity(worlds, sizes, only)),
        {},
        f"Wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, by turns on stand and waist, kinematic; each "
        f"{sizes.first} first and {sizes.later} later trials, {sizes.trouble} in each kind of trouble, a "
        f"lifetime of {sizes.lifetime} trials; paired 95 % t intervals over worlds.{short}",
    )


COLUMNS = [
    *("agent", "constant", "value", "source", "factor", "tried", "condition"),
    *("motions", "motions low", "motions high", "success", "success low", "success high"),
    *("differing", "verdict"),
]
VERDICTS = ("raises an error", "sensitive", "not shown", "insensitive", "no trial differed")
"""The clearest first."""


def sensitivity(
    worlds: int = 20, sizes: Sizes | None = None, only: Collection[str] = (), jobs: int | None = None
) -> pd.DataFrame:
    """What halving and doubling each constant does; one row a constant and factor.

    Args:
        worlds: How many, at least 2; from `FIRST_WORLD` on.
        sizes: Trials; the default takes some 15 minutes on two cores.
        only: Labels of constants to vary; all where it is empty.
        jobs: Processes; None: one for each core.

    Returns:
        The columns agent, constant, value, source, factor, tried, condition (that with the clearest change),
        motions (%) and success (points) with the ends of their 95 % intervals, differing (the share of all
        trials, in %, that came out otherwise) and verdict.
    """
    found = effects(worlds, sizes, only, jobs)
    rank = found["verdict"].map(VERDICTS.index)
    order = found.assign(rank=rank, size=-found["motions"].abs()).sort_values(["rank", "size"], kind="stable")
    key = ["agent", "constant", "factor"]
    clearest = order.drop_duplicates(key).sort_index()
    shares = found.groupby(key, sort=False)["differing"].mean().rename("differing")
    return (
        clearest.drop(columns=["rank", "size", "differing"])
        .merge(shares, on=key, sort=False)[COLUMNS]
        .reset_index(drop=True)
    )


def readable(found: pd.DataFrame) -> pd.DataFrame:
    """A table for people: each change and its interval in one column of text."""
    shown = found[COLUMNS[:7]].assign(value=found["value"].map("{:g}".format))
    shown["tried"] = found["tried"].map("{:.3g}".format)
    for name, unit in (("motions", "%"), ("success", "points")):
        parts = found[[name, f"{name} low", f"{name} high"]].to_numpy()
        shown[f"{name}, {unit}"] = [f"{value:+.1f} [{low:+.1f}, {high:+.1f}]" for value, low, high in parts]
    shown["differing, %"] = found["differing"].map("{:.0f}".format)
    return shown.assign(verdict=found["verdict"])


def effects(
    worlds: int = 20, sizes: Sizes | None = None, only: Collection[str] = (), jobs: int | None = None
) -> pd.DataFrame:
    """As `sensitivity`, one row a constant, factor and condition."""
    variations = {
        agent: tuple(
            Variation(each, each.times(factor))
            for each in constants_of(agent)
            for factor in FACTORS
            if (not only or each.label in only) and each.times(factor) != each.value
        )
        for agent in MODULES
    }
    tasks = [
        Task(
            agent,
            condition,
            seed,
            MOUNTS[seed % len(MOUNTS)],
            sizes or Sizes(),
            (Variation(), *variations[agent]),
        )
        for agent in reversed(MODULES)
        if variations[agent]
        for condition in CONDITIONS[agent]
        for seed in range(FIRST_WORLD, FIRST_WORLD + worlds)
    ]
    with side_by_side(jobs) as each:
        results = dict(zip(tasks, each(carry_out, tasks), strict=True))
    return pd.DataFrame(
        row
        for agent, own in variations.items()
        for i, variation in enumerate(own, 1)
        for row in _rows(agent, variation, i, results)
    )


def _rows(agent: str, variation: Variation, i: int, results: dict[Task, Array]) -> Iterator[dict[str, Any]]:
    """The rows of the i-th variation."""
    constant = variation.constant
    assert constant is not None
    for condition in CONDITIONS[agent]:
        found = np.array(
            [each for task, each in results.items() if (task.agent, task.condition) == (agent, condition)]
        )
        base, changed = found[:, 0], found[:, i]  # (worlds, trials, motions and success)
        differing = 100 * float((base != changed).any(-1).mean())
        yield {
            "agent": agent,
            "constant": constant.label,
            "value": constant.value,
            "source": constant.source,
            "factor": FACTORS[int(variation.value > constant.value)],
            "tried": variation.value,
            "condition": condition,
            **judged(base.mean(1), changed.mean(1)),
            "differing": differing,
            **({} if differing else {"verdict": VERDICTS[-1]}),
        }


def judged(base: Array, changed: Array) -> dict[str, Any]:
    """Changes from `base` to `changed`, each motions and success (worlds, 2), with intervals and verdict.

    Worlds are the units: trials in one world are averaged before.
    """
    if np.isnan(changed).any():
        return {**dict.fromkeys(COLUMNS[7:13], np.nan), "verdict": VERDICTS[0]}
    motions = relative_change(base[:, 0], changed[:, 0])
    success = mean_estimate(changed[:, 1] - base[:, 1])
    numbers = [100 * part for each in (motions, success) for part in (each.value, each.low, each.high)]
    return {**dict(zip(COLUMNS[7:13], numbers, strict=True)), "verdict": verdict(motions, success)}


def verdict(motions: Estimate, success: Estimate) -> str:
    """What the intervals of both changes show, as shares of 1."""
    both = ((motions, MOTIONS), (success, SUCCESS))
    if any(change.low > limit or change.high < -limit for change, limit in both):
        return "sensitive"
    if all(-limit <= change.low and change.high <= limit for change, limit in both):
        return "insensitive"
    return "not shown"
