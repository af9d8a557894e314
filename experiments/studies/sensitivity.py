"""Which constants matter: each one halved and doubled, in wild worlds that nobody tuned on.

Nothing is changed by what is found: a table lists it. Base and variations meet the same worlds, objects and
noise, so that differences are paired.

A constant is an upper-case number of a listed module or of a class in it, or a number among an agent's
settings. All that are found are varied, but for guards (their docstrings say so, and against what) and for
the few in `LEFT_OUT`, each with its reason.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.util import resolve_name
from types import ModuleType
from typing import Any, TypeGuard

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
from agents.memory.memory import Memory
from agents.memory.remembered import Remembered
from agents.servo.unified import UnifiedServo
from calfree_gym import MOUNTS
from calfree_gym.geometry import Array
from calfree_gym.world import World
from experiments.evaluation import evaluate
from experiments.reporting.tables import Table
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import Estimate, mean_estimate, relative_change
from experiments.studies.common import CAP, REACH, side_by_side

FIRST_WORLD = 5000
"""`unified_servo` and `memory` were not tuned on worlds from here on; the study `priors` uses them, too."""
FACTORS = (0.5, 2.0)
MOTIONS, SUCCESS = 0.05, 0.01
"""Changes of motions (a share) and of success (one point) that are too small to matter."""
NEAR_PX = 8
"""In trouble a trial succeeds where the true error comes within this: noise of 3 px hides a smaller one."""

# -- The constants

MODULES: dict[str, tuple[str, ...]] = {
    "unified_servo": (
        "agents.servo.unified",
        "agents.servo.image_model",
        "agents.servo.slopes",
        "agents.servo.perception",
    ),
    "memory": ("agents.memory",),
}
"""What each agent is made of: modules, and packages with all modules in them. Memory corrects by
`unified_servo`, whose constants are varied there alone."""

SETTINGS: dict[str, tuple[type[Any], ...]] = {
    "unified_servo": (UnifiedServo,),
    "memory": (Memory, Remembered),
}
"""Whose arguments are an agent's settings."""

LEFT_OUT: dict[str, str] = {
    "seed": "no constant",
    "jump_px": "acts with other servos alone",
    "sure_px": "infinite in reaching",
    "camera_change.MEAN_SQUARE_MEDIAN": "exact",
    "gaussian_process.IMAGE_AREA": "exact: two by two image units",
    "camera_change.PARAMETERS": "exact: there are twelve",
    "Archive.KEPT": "bounds what is kept; no lifetime here has this many changes",
    "camera_change.TURNED": "only names a change, and moves nothing",
    "camera_change.ZOOMED": "only names a change, and moves nothing",
    "camera_change.MOVED_PX": "only names a change, and moves nothing",
    "camera_change.PARALLAX_PX": "only names a change, and moves nothing",
}
"""Constants that are not varied, and why; guards aside."""

BOUNDS: dict[str, tuple[float, float]] = {
    "Reach.AS_UNKNOWN": (0.0, 0.99),
    "ChangeDetector.USUAL_QUANTILE": (0.0, 0.99),
    "gaussian_process.NOISIER": (1.01, np.inf),
}
"""Between which values a constant makes sense: a share below 1, a growth above it."""

_SOURCES = {
    "guard": "guard",
    "tuned": "tuned",
    "derived": "derived",
    "source": "from a source",
    "choice": "choice",
}
_WORDS = re.compile(rf"\b({'|'.join(_SOURCES)})", re.IGNORECASE)


@dataclass(frozen=True)
class Constant:
    """A named number of an agent.

    Attributes:
        owner: The class that it belongs to; empty for a module's own.
        source: Where it comes from, by its docstring: "derived", "from a source", "tuned", "choice", "guard"
            or "not said".
    """

    agent: str
    module: str
    owner: str
    name: str
    value: float
    source: str
    setting: bool = False

    @property
    def label(self) -> str:
        """Its name with that of its class or module; a setting's name alone."""
        return self.name if self.setting else f"{self.owner or self.module.rpartition('.')[2]}.{self.name}"

    def times(self, factor: float) -> float:
        """The value to try: whole and at least 1 where it is whole, and within `BOUNDS`."""
        if isinstance(self.value, int):
            return max(1, round(self.value * factor))
        least, most = BOUNDS.get(self.label, (0.0, np.inf))
        return min(max(self.value * factor, least), most)


def constants_of(agent: str) -> list[Constant]:
    """The constants of an agent that are varied, settings first."""
    found = [*_settings(agent)]
    for module in modules(agent):
        found += numbers(agent, module)
    return [each for each in found if each.label not in LEFT_OUT and each.source != "guard"]


def modules(agent: str) -> list[ModuleType]:
    """The modules that an agent is made of."""
    return [module for name in MODULES[agent] for module in _with_submodules(importlib.import_module(name))]


def numbers(agent: str, module: ModuleType) -> Iterator[Constant]:
    """All upper-case numbers that a module defines, in classes too."""
    for owner, body in _bodies(module):
        holder = getattr(module, owner) if owner else module
        for name, docstring in _assigned(body):
            value = vars(holder).get(name)
            if name.isupper() and _is_number(value):
                yield Constant(agent, module.__name__, owner, name, value, _source(docstring))


@contextmanager
def varied(constant: Constant | None, value: float) -> Iterator[dict[str, float]]:
    """Gives a constant another value for a while, wherever it is read; where there is none, changes nothing.

    Yields the settings to make the agent with: the setting, or none where it is a constant in the code.
    """
    if constant is None or constant.setting:
        yield {constant.name: value} if constant else {}
        return
    changed = [
        (holder, alias, getattr(holder, alias))
        for holder, alias in places(constant.module, constant.owner, constant.name)
    ]
    try:
        for holder, alias, _ in changed:
            setattr(holder, alias, value)
        yield {}
    finally:
        for holder, alias, old in changed:
            setattr(holder, alias, old)


@cache
def places(module: str, owner: str, name: str) -> tuple[tuple[Any, str], ...]:
    """Where a constant is read from: its class; or its module, and all modules that import it by name."""
    defining = importlib.import_module(module)
    if owner:
        return ((getattr(defining, owner), name),)
    found = {(module, name)}
    everywhere = list(_with_submodules(agents))
    while True:
        importing = {
            (each.__name__, alias.asname or alias.name)
            for each in everywhere
            for node in ast.walk(_tree(each))
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
            if (resolve_name("." * node.level + (node.module or ""), each.__package__), alias.name) in found
        }
        if importing <= found:
            return tuple((sys.modules[where], alias) for where, alias in sorted(found))
        found |= importing


def _settings(agent: str) -> Iterator[Constant]:
    for kind in SETTINGS[agent]:
        for name, parameter in inspect.signature(kind).parameters.items():
            if _is_number(parameter.default):
                source = _source(_entry(kind, name), inspect.getdoc(kind) or "")
                yield Constant(agent, kind.__module__, "", name, parameter.default, source, setting=True)


def _entry(kind: type[Any], name: str) -> str:
    """What a class's docstring says of an argument."""
    found = re.search(rf"^ +{name}: (.*(?:\n {{8,}}.*)*)", inspect.getdoc(kind) or "", re.MULTILINE)
    return found[1] if found else ""


def _with_submodules(module: ModuleType) -> Iterator[ModuleType]:
    yield module
    for found in pkgutil.iter_modules(getattr(module, "__path__", ()), module.__name__ + "."):
        if found.name not in UNWANTED:
            yield from _with_submodules(importlib.import_module(found.name))


UNWANTED = ("agents.neural",)
"""Not loaded: it needs packages that these agents do without."""


@cache
def _tree(module: ModuleType) -> ast.Module:
    return ast.parse(inspect.getsource(module))


def _bodies(module: ModuleType) -> Iterator[tuple[str, list[ast.stmt]]]:
    """A module's statements, and those of each of its classes by its name."""
    body = _tree(module).body
    yield "", body
    for node in body:
        if isinstance(node, ast.ClassDef):
            yield node.name, node.body


def _assigned(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    """Names that are assigned, each with the docstring that follows."""
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        else:
            continue
        docstring = ""
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            docstring = str(after.value.value)
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name):
                    yield name.id, docstring


def _source(*docstrings: str) -> str:
    """Where a number comes from, by the first docstring that says it."""
    for docstring in docstrings:
        if found := _WORDS.search(docstring):
            return _SOURCES[found[1].lower()]
    return "not said"


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


# -- What they are tried in


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


Variation = tuple[Constant | None, float]
"""A constant and its other value; the base, where there is no constant."""
BASE: Variation = (None, 0.0)


@dataclass(frozen=True)
class Task:
    """All variations of an agent under one condition in one world."""

    agent: str
    condition: str
    seed: int
    sizes: Sizes
    variations: tuple[Variation, ...]


CONDITIONS = {
    "unified_servo": ("first trials", "later trials", "mistaken points", "late points"),
    "memory": ("changed cameras",),
}
"""What each agent is measured in."""
TROUBLE = {
    "mistaken points": ({"type": "point_outliers", "share": 0.2}, {"type": "point_noise", "px": 3.0}),
    "late points": ({"type": "latency", "motions": 1}, {"type": "point_dropout", "share": 0.2}),
}
"""What is done to the world before the first trial, by the condition."""


def measured(task: Task, env: gym.Env[Any, Any], settings: dict[str, Any]) -> Array:
    """Motions and success of each trial (trials, 2); in trouble until the true error is small."""
    sizes = task.sizes
    if task.condition in TROUBLE:
        agent = agents.make(task.agent, env, **settings)
        records = evaluate(agent, EndsNear(env), sizes.trouble, task.seed)
        return np.array([(each.motions, each.motions_to[NEAR_PX] is not None) for each in records], float)
    if task.condition == "first trials":  # none of which teaches anything
        records = evaluate(agents.make(task.agent, env, **settings), env, sizes.first, task.seed)
    else:
        later = task.condition == "later trials"
        recorder = LifetimeRecorder(env, task.seed)
        trials = 1 + sizes.later if later else sizes.lifetime
        records = learn_trials(agents.make(task.agent, recorder, **settings), recorder, trials)[later:]
    return np.array([(each.motions_per_reach(CAP), each.success) for each in records], float)


class EndsNear(gym.Wrapper[Any, Any, Any, Any]):
    """Ends a trial where gripper and object truly are within `NEAR_PX`: in noise an observation may err."""

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Makes one motion."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        near = bool(info["truth"]["error_px"] <= NEAR_PX)
        return observation, reward, terminated or near, truncated, info


def _arguments(task: Task) -> dict[str, Any]:
    """What the environment has beside the world; in trouble no observed rendezvous ends a trial."""
    changes: list[tuple[int, dict[str, Any]]] = [(0, change) for change in TROUBLE.get(task.condition, ())]
    if task.condition == "changed cameras":
        trials = task.sizes.lifetime
        aim = {"type": "camera_aim", "degrees": 10, "camera": "left"}
        changes = [(trials // 2, aim), (3 * trials // 4, {"type": "camera_replace", "camera": "left"})]
    schedule = [{"at": {"trial": trial}, "do": change} for trial, change in changes]
    return {"perturbations": schedule or None, "terminate_on_success": task.condition not in TROUBLE}


@cache
def _world(seed: int, mount: str) -> World:
    env: Any = gym.make(REACH, camera_mount=mount, dynamics="kinematic")
    env.reset(seed=seed)
    return env.unwrapped.world


def carry_out(task: Task) -> Array:
    """Motions and success of a task's trials (variations, trials, 2); NaN where an error was raised."""
    mount = MOUNTS[task.seed % len(MOUNTS)]
    fixed: dict[str, Any] = {"camera_mount": mount, "dynamics": "kinematic", "max_episode_steps": CAP}
    env = gym.make(REACH, world=_world(task.seed, mount), **fixed, **_arguments(task))
    found: list[Array] = []
    for constant, value in task.variations:
        try:
            with varied(constant, value) as settings:
                found.append(measured(task, env, settings))
        except (ArithmeticError, ValueError, LookupError):
            if constant is None:
                raise
            found.append(np.full_like(found[0], np.nan))
    return np.array(found)


# -- What comes of it


def tables(worlds: int = 20) -> Iterator[Table]:
    """The one table, for people."""
    sizes = Sizes()
    yield Table(
        "constants",
        "Each constant of unified_servo and memory, halved and doubled",
        readable(clearest(effects(worlds, sizes))),
        {},
        f"Wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, by turns on stand and waist, kinematic; each "
        f"{sizes.first} first and {sizes.later} later trials, {sizes.trouble} in each kind of trouble, a "
        f"lifetime of {sizes.lifetime} trials; paired 95 % t intervals over worlds.",
    )


NUMBERS = ["motions", "motions low", "motions high", "success", "success low", "success high"]
COLUMNS = [
    *("agent", "constant", "value", "source", "factor", "tried", "condition"),
    *NUMBERS,
    *("differing", "verdict"),
]
VERDICTS = ("raises an error", "sensitive", "not shown", "insensitive", "no trial differed")
"""The clearest first."""


def clearest(found: pd.DataFrame) -> pd.DataFrame:
    """Of `effects`, the condition with the clearest change; differing: the share of the trials of all."""
    rank = found["verdict"].map(VERDICTS.index)
    order = found.assign(rank=rank, size=-found["motions"].abs()).sort_values(["rank", "size"], kind="stable")
    key = ["agent", "constant", "factor"]
    shares = found.groupby(key, sort=False)["differing"].mean().rename("differing")
    first = order.drop_duplicates(key).sort_index().drop(columns="differing")
    return first.merge(shares, on=key, sort=False)[COLUMNS].reset_index(drop=True)


def readable(found: pd.DataFrame) -> pd.DataFrame:
    """A table for people: each change and its interval in one column of text."""
    shown = found[COLUMNS[:7]].assign(value=found["value"].map("{:g}".format))
    shown["tried"] = found["tried"].map("{:.3g}".format)
    for name, unit in (("motions", "%"), ("success", "points")):
        parts = found[[name, f"{name} low", f"{name} high"]].to_numpy()
        shown[f"{name}, {unit}"] = [f"{value:+.1f} [{low:+.1f}, {high:+.1f}]" for value, low, high in parts]
    shown["differing, %"] = found["differing"].map("{:.0f}".format)
    return shown.assign(verdict=found["verdict"])


def effects(worlds: int, sizes: Sizes, only: Collection[str] = (), jobs: int | None = None) -> pd.DataFrame:
    """What halving and doubling each constant, or only some, does under each condition.

    Returns:
        The `COLUMNS`: motions (%) and success (points) with the ends of their 95 % intervals; differing is
        the share of trials (%) that came out otherwise.
    """
    variations: dict[str, list[tuple[Constant, float]]] = {
        agent: [
            (each, each.times(factor))
            for each in constants_of(agent)
            for factor in FACTORS
            if (not only or each.label in only) and each.times(factor) != each.value
        ]
        for agent in MODULES
    }
    tasks = [
        Task(agent, condition, seed, sizes, (BASE, *variations[agent]))
        for agent in reversed(MODULES)
        if variations[agent]
        for condition in CONDITIONS[agent]
        for seed in range(FIRST_WORLD, FIRST_WORLD + worlds)
    ]
    found: dict[tuple[str, str], list[Array]] = {}
    with side_by_side(jobs) as each_of:
        for task, scores in zip(tasks, each_of(carry_out, tasks), strict=True):
            found.setdefault((task.agent, task.condition), []).append(scores)
    rows = []
    for agent, own in variations.items():
        for i, (constant, tried) in enumerate(own, 1):
            for condition in CONDITIONS[agent]:
                base, changed = np.array(found[agent, condition])[:, [0, i]].swapaxes(0, 1)
                row = {
                    "agent": agent,
                    "constant": constant.label,
                    "value": constant.value,
                    "source": constant.source,
                    "factor": FACTORS[tried > constant.value],
                    "tried": tried,
                    "condition": condition,
                    **judged(base.mean(1), changed.mean(1)),
                    "differing": 100 * float((base != changed).any(-1).mean()),
                }
                rows.append(row if row["differing"] else row | {"verdict": VERDICTS[-1]})
    return pd.DataFrame(rows)


def judged(base: Array, changed: Array) -> dict[str, Any]:
    """Changes from `base` to `changed`, each motions and success (worlds, 2), with intervals and verdict.

    Worlds are the units: trials in one world are averaged before.
    """
    if np.isnan(changed).any():
        return {**dict.fromkeys(NUMBERS, np.nan), "verdict": VERDICTS[0]}
    motions = relative_change(base[:, 0], changed[:, 0])
    success = mean_estimate(changed[:, 1] - base[:, 1])
    numbers = [100 * part for each in (motions, success) for part in (each.value, each.low, each.high)]
    return {**dict(zip(NUMBERS, numbers, strict=True)), "verdict": verdict(motions, success)}


def verdict(motions: Estimate, success: Estimate) -> str:
    """What the intervals of both changes show, as shares of 1."""
    both = ((motions, MOTIONS), (success, SUCCESS))
    if any(change.low > limit or change.high < -limit for change, limit in both):
        return "sensitive"
    if all(-limit <= change.low and change.high <= limit for change, limit in both):
        return "insensitive"
    return "not shown"
