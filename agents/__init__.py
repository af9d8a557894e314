"""Controllers of the black box, made by name: `agents.make("grid_table", env, cells=8)`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from inspect import signature
from typing import Any

import gymnasium as gym

from agents.agent import Agent
from agents.knowledge.grid_table import GridTable
from agents.learning_servo import LearningServo
from agents.model_based import ModelBased
from agents.random_agent import RandomAgent
from agents.self_calibrating import SelfCalibrating
from agents.servo.affine_stereo import AffineStereo
from agents.servo.joint_space import JointSpaceServo
from agents.servo.unified import UnifiedServo
from agents.servo.work_plane import WorkPlaneServo
from agents.servo_agent import ServoAgent
from calfree_gym.world import near_misses

__all__ = ["Agent", "make", "names"]

Environment = gym.Env[Any, Any]


def _unified_servo(env: Environment, seed: int = 0, **servo: Any) -> Agent:
    return ServoAgent(env, UnifiedServo(**servo), seed)


def _work_plane_servo(env: Environment, seed: int = 0, **servo: Any) -> Agent:
    return ServoAgent(env, WorkPlaneServo(**servo), seed)


def _grid_table(env: Environment, seed: int = 0, cells: int = 8, rate: float = 0.7, **servo: Any) -> Agent:
    motors = env.action_space.shape[0]  # type: ignore[index]
    paper = {"estimator": "test_motions", **servo}
    return LearningServo(env, GridTable(motors, cells, rate), UnifiedServo(**paper), seed)


def _sac(env: Environment, seed: int = 0, **settings: Any) -> Agent:
    from agents.neural.sb3 import SacAgent

    return SacAgent(env, seed, **settings)


_MAKERS: dict[str, Callable[..., Agent]] = {
    "random": RandomAgent,
    "unified_servo": _unified_servo,
    "work_plane_servo": _work_plane_servo,
    "grid_table": _grid_table,
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
    allowed = _settings_of(name)
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


def _settings_of(name: str) -> tuple[str, ...]:
    """The settings that an agent takes."""
    if name == "sac":
        from agents.neural.sb3 import SETTINGS

        return SETTINGS
    parameters = signature(_MAKERS[name]).parameters.values()
    named = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD]
    servo = WorkPlaneServo if name == "work_plane_servo" else UnifiedServo
    of_servo = [field.name for field in fields(servo)] if len(named) < len(parameters) else []
    return (*named[1:], *of_servo)
