"""Controllers of the black box, made by name: `agents.make("grid_table", env, cells=8)`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from inspect import signature
from typing import Any

import gymnasium as gym

from agents.base.agent import Agent
from agents.calibrated.affine_stereo import AffineStereo
from agents.calibrated.model_based import ModelBased
from agents.calibrated.self_calibrating import SelfCalibrating
from agents.knowledge.factored_table import FactoredTable
from agents.knowledge.gaussian_process import GaussianProcess
from agents.knowledge.grid_table import GridTable
from agents.knowledge.interface import Knowledge
from agents.knowledge.support_points import SupportPoints
from agents.learning_servo import LearningServo
from agents.random_agent import RandomAgent
from agents.servo.joint_space import JointSpaceServo
from agents.servo.servo_agent import ServoAgent
from agents.servo.unified import UnifiedServo
from agents.servo.work_plane import WorkPlaneServo
from calfree_gym.errors import near_misses

__all__ = ["Agent", "make", "names"]

Environment = gym.Env[Any, Any]


def _unified_servo(env: Environment, seed: int = 0, **servo: Any) -> Agent:
    return ServoAgent(env, UnifiedServo(**servo), seed)


def _work_plane_servo(env: Environment, seed: int = 0, **servo: Any) -> Agent:
    return ServoAgent(env, WorkPlaneServo(**servo), seed)


def _learning_servo(
    env: Environment,
    seed: int = 0,
    knowledge: str = "memory",
    servo: str = "unified_servo",
    jump_px: float = 60.0,
    every_look: bool = True,
    on_change: str = "keep",
    **settings: Any,
) -> Agent:
    own = _own_settings(KNOWLEDGE[knowledge])
    remembered = KNOWLEDGE[knowledge](
        env.action_space.shape[0],  # type: ignore[index]
        **{name: settings.pop(name) for name in own if name in settings},
    )
    return LearningServo(env, remembered, SERVOS[servo](**settings), seed, jump_px, every_look, on_change)


def _own_settings(knowledge: Callable[..., Knowledge]) -> tuple[str, ...]:
    return tuple(name for name in signature(knowledge).parameters if name != "motors")


def _sac(env: Environment, seed: int = 0, **settings: Any) -> Agent:
    from agents.neural.sb3 import SacAgent

    return SacAgent(env, seed, **settings)


KNOWLEDGE: dict[str, Callable[..., Knowledge]] = {
    "grid_table": GridTable,
    "factored_table": FactoredTable,
    "support_points": SupportPoints,
    "gaussian_process": GaussianProcess,
    "memory": GaussianProcess,
}
"""Knowledge bases by name; `memory` is the best of them."""
SERVOS: dict[str, type[UnifiedServo] | type[WorkPlaneServo]] = {
    "unified_servo": UnifiedServo,
    "work_plane_servo": WorkPlaneServo,
}
"""The servos that knowledge can be laid over."""
DEFAULTS: dict[str, dict[str, Any]] = {
    "grid_table": {"every_look": False, "estimator": "test_motions", "jump_px": math.inf},
    "gaussian_process": {"on_change": "recognise"},
    "memory": {"on_change": "recognise"},
}
"""Settings of agents that bear a knowledge base's name. With the paper's table only success teaches, what is
recalled is always tried, and test motions correct."""

_MAKERS: dict[str, Callable[..., Agent]] = {
    "random": RandomAgent,
    "unified_servo": _unified_servo,
    "work_plane_servo": _work_plane_servo,
    "learning_servo": _learning_servo,
    **{name: partial(_learning_servo, knowledge=name, **DEFAULTS.get(name, {})) for name in KNOWLEDGE},
    "joint_space_servo": JointSpaceServo,
    "affine_stereo": AffineStereo,
    "model_based": ModelBased,
    "self_calibrating": SelfCalibrating,
    "sac": _sac,
}


def names() -> tuple[str, ...]:
    """The names that `make` knows."""
    return tuple(_MAKERS)


def make(name: str, env: Environment, **settings: Any) -> Agent:
    """Makes the agent `name` for `env`.

    Args:
        name: One of `names()`.
        env: The environment that it learns in, and whose spaces it acts in.
        **settings: Of the agent; `seed` for all.

    Raises:
        ValueError: An unknown name, with the near misses, or a setting that is not allowed.
    """
    if name not in _MAKERS:
        hint = near_misses(name, _MAKERS)
        raise ValueError(f"unknown agent {name!r}{hint}; allowed: {', '.join(_MAKERS)}")
    shape = getattr(env.action_space, "shape", None)
    if shape is None or len(shape) != 1:
        raise ValueError(f"agent {name!r} acts in one environment at a time; this one's actions are {shape}")
    allowed = _settings_of(name, settings)
    for setting in settings:
        if setting not in allowed:
            hint = near_misses(setting, allowed)
            raise ValueError(
                f"agent {name!r} has no setting {setting!r}{hint}; allowed: {', '.join(allowed)}"
            )
    try:
        return _MAKERS[name](env, **settings)
    except (TypeError, ValueError) as error:
        raise ValueError(f"agent {name!r}: {error}") from error


def _settings_of(name: str, given: Mapping[str, Any]) -> tuple[str, ...]:
    """The settings that an agent takes; a learning servo's depend on the knowledge and servo `given`."""
    if name == "sac":
        from agents.neural.sb3 import SETTINGS

        return SETTINGS
    parameters = signature(_MAKERS[name]).parameters.values()
    named = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD and p.name != "env"]
    if len(named) == len(parameters) - 1:
        return tuple(named)
    if "knowledge" not in named:
        servo = SERVOS[name]
        return (*named, *(field.name for field in fields(servo)))
    if name in KNOWLEDGE:
        named.remove("knowledge")
    chosen = {"servo": "unified_servo", "knowledge": "memory", **given}
    if name in KNOWLEDGE:
        chosen["knowledge"] = name
    for setting, known in (("knowledge", KNOWLEDGE), ("servo", SERVOS)):
        if chosen[setting] not in known:
            raise ValueError(
                f"agent {name!r}: {setting} is {chosen[setting]!r}{near_misses(chosen[setting], known)}; "
                f"allowed: {', '.join(known)}"
            )
    own = _own_settings(KNOWLEDGE[chosen["knowledge"]])
    return (*named, *own, *(field.name for field in fields(SERVOS[chosen["servo"]])))
