"""The named constants of the agents: found in the code, each with where it comes from, varied in place.

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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.util import resolve_name
from statistics import NormalDist
from types import ModuleType
from typing import Any, TypeGuard

import numpy as np

import agents
from agents.memory.memory import Memory
from agents.memory.remembered import Remembered
from agents.servo.unified import UnifiedServo

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

OTHERS: dict[str, str] = {
    "agents.base": "no choices: how many points there are",
    "agents.body_schema": "another agent over a servo",
    "agents.calibrated": "the calibrated robots",
    "agents.servo.jacobian": "other servos",
    "agents.grasp": "the procedure of a grasp",
    "agents.knowledge.learning_servo": "tables over a servo",
    "agents.knowledge.grid_table": "other knowledge bases",
    "agents.knowledge.factored_table": "other knowledge bases",
    "agents.knowledge.support_points": "other knowledge bases",
    "agents.neural": "the neural agents",
    "agents.registry": "names of agents",
    "agents.servo.jacobian_servo": "another servo",
    "agents.servo.joint_space": "another servo",
    "agents.servo.paper": "another servo",
    "agents.servo.redundancy": "other servos",
    "agents.servo.safe": "safe first motions, before a servo",
    "agents.servo.servo_agent": "checks of settings",
    "agents.servo.trial": "other servos",
    "agents.servo.work_plane": "another servo",
}
"""Modules and packages with numbers of their own that are no part of these agents."""

SETTINGS: dict[str, tuple[type[Any], ...]] = {
    "unified_servo": (UnifiedServo,),
    "memory": (Memory, Remembered),
}
"""Whose arguments are an agent's settings."""

LEFT_OUT: dict[str, str] = {
    "seed": "no constant",
    "jump_px": "acts with other servos alone",
    "sure_px": "infinite in reaching",
    "NoiseEstimate.QUANTILE_OF_NORMAL": "exact, follows from QUANTILE",
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

ALONG: dict[str, tuple[str, Callable[[float], float]]] = {
    "NoiseEstimate.QUANTILE": (
        "QUANTILE_OF_NORMAL",
        lambda quantile: NormalDist().inv_cdf((1 + quantile) / 2),
    ),
}
"""Constants that another one of the same class follows from."""

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
        agent: The agent that it is varied in.
        module: Where it is defined.
        owner: The class that it belongs to; empty for a module's own.
        name: Its name there.
        value: Its value.
        source: Where it comes from, by its docstring: "derived", "from a source", "tuned", "choice", "guard"
            or "not said".
        setting: Whether it is a setting of the agent.
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

    Yields:
        The settings to make the agent with: the setting, or none where it is a constant in the code.
    """
    if constant is None or constant.setting:
        yield {constant.name: value} if constant else {}
        return
    values = {constant.name: value}
    if constant.label in ALONG:
        name, follows = ALONG[constant.label]
        values[name] = follows(value)
    changed = [
        (holder, alias, getattr(holder, alias), new)
        for name, new in values.items()
        for holder, alias in places(constant.module, constant.owner, name)
    ]
    try:
        for holder, alias, _, new in changed:
            setattr(holder, alias, new)
        yield {}
    finally:
        for holder, alias, old, _ in changed:
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
            if (_imported(node, each), alias.name) in found
        }
        if importing <= found:
            return tuple((sys.modules[where], alias) for where, alias in sorted(found))
        found |= importing


def _imported(node: ast.ImportFrom, module: ModuleType) -> str:
    """Name of the module from which a module imports, relatively or not."""
    return resolve_name("." * node.level + (node.module or ""), module.__package__)


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
