"""Agents by name, and the settings that each of them takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from inspect import Parameter
from typing import Any

import gymnasium as gym

from calfree_gym.errors import check_choice, check_flag, near_misses

from .adaptation.memory import Memory
from .adaptation.remembered import Remembered
from .base.agent import Agent
from .base.settings import named_settings, tuned_settings
from .body_schema.agent import BodySchema
from .calibrated.affine_stereo import AffineStereo
from .calibrated.model_based import ModelBased
from .calibrated.self_calibrating import SelfCalibrating
from .grasp.agent import Grasp
from .grasp.inserting.agent import Insert
from .grasp.inserting.yoshimi_allen import YoshimiAllen
from .grasp.task import TASKS, task_of
from .grasp.trial import SURE_PX
from .knowledge.factored_table import FactoredTable
from .knowledge.grid_table import GridTable
from .knowledge.learning_servo import LearningServo
from .knowledge.support_points import SupportPoints
from .reference.oracle import Oracle
from .reference.random_agent import RandomAgent
from .servo import SERVOS, make_servo
from .servo.joint_space import JointSpaceServo
from .servo.safe.agent import SafeStart
from .servo.servo_agent import ServoAgent

Environment = gym.Env[Any, Any]


def _servo_agent(env: Environment, seed: int = 0, *, servo: str, **settings: Any) -> Agent:
    return ServoAgent(env, make_servo(servo, settings), seed)


def _safe_start(env: Environment, seed: int = 0, servo: str = "unified_servo", **settings: Any) -> Agent:
    return SafeStart(env, make_servo(servo, settings), seed)


def _body_schema(env: Environment, seed: int = 0, servo: str = "unified_servo", **settings: Any) -> Agent:
    return BodySchema(env, make_servo(servo, settings), seed)


def _learning_servo(env: Environment, seed: int = 0, knowledge: str = "memory", **settings: Any) -> Agent:
    maker = _memory if knowledge == "memory" else _table
    return maker(env, seed, knowledge, **settings)


def _table(
    env: Environment,
    seed: int,
    knowledge: str,
    servo: str = "unified_servo",
    jump_px: float = 60.0,
    every_look: bool = True,
    **settings: Any,
) -> Agent:
    table = _knowledge(env.action_space.shape[0], knowledge, settings)  # type: ignore[index]
    return LearningServo(env, table, make_servo(servo, settings), seed, jump_px, every_look)


def _memory(
    env: Environment,
    seed: int,
    knowledge: str,
    servo: str = "unified_servo",
    jump_px: float = 60.0,
    on_change: str = "recognise",
    **settings: Any,
) -> Agent:
    remembered = _knowledge(env.action_space.shape[0], knowledge, settings)  # type: ignore[index]
    return Memory(env, remembered, make_servo(servo, settings), seed, jump_px, on_change)


def _knowledge(motors: int, name: str, settings: dict[str, Any], **keys: int) -> Any:
    """A knowledge base by its name, over registers of so many motors; takes its own from the settings."""
    own = {each: settings.pop(each) for each in _own_settings(name) if each in settings}
    return KNOWLEDGE[name](motors, **own, **keys)


def _own_settings(knowledge: str) -> dict[str, Any]:
    settings = named_settings(KNOWLEDGE[knowledge])
    return {name: default for name, default in settings.items() if name not in ("motors", "dimensions")}


def _grasp(
    env: Environment,
    seed: int = 0,
    knowledge: str | None = "memory",
    servo: str = "unified_servo",
    intermediate: str = "along_axis",
    orientation: str = "least_squares",
    tries: int = 2,
    direction: bool = False,
    **settings: Any,
) -> Agent:
    if servo == "unified_servo":
        settings = {"sure_px": SURE_PX} | settings
    check_flag("direction", direction)
    table = None
    if direction:
        check_choice("knowledge", knowledge, SIX_DIMENSIONS)
        turned = env.action_space.shape[0] - 1  # type: ignore[index]
        table, knowledge = _knowledge(turned, str(knowledge), settings, dimensions=6), None
    own = {"servo": servo} | settings
    reacher = partial(_servo_agent, seed=seed, **own)
    if knowledge is not None:
        reacher = partial(_learning_servo, seed=seed, knowledge=knowledge, **own)
    return Grasp(env, reacher, intermediate, orientation, tries, seed, table)


def _insert(env: Environment, seed: int = 0, servo: str = "unified_servo", **settings: Any) -> Agent:
    if servo == "unified_servo":
        settings = {"sure_px": SURE_PX} | settings
    return Insert(env, partial(_servo_agent, seed=seed, servo=servo, **settings), seed)


def _sb3(env: Environment, seed: int = 0, **settings: Any) -> Agent:
    from .neural.sb3.agent import Sb3Agent

    return Sb3Agent(env, seed, **settings)


def _self_taught(env: Environment, seed: int = 0, *, learner: str, **settings: Any) -> Agent:
    from .neural.self_supervised import AGENTS

    return AGENTS[learner](env, seed, **settings)


def _recurrent_servo(env: Environment, seed: int = 0, weights: str | None = None) -> Agent:
    from .neural.recurrent_servo.agent import RecurrentServo

    return RecurrentServo(env, seed, weights)


KNOWLEDGE: dict[str, Callable[..., Any]] = {
    "grid_table": GridTable,
    "factored_table": FactoredTable,
    "support_points": SupportPoints,
    "memory": Remembered,
}
"""Knowledge bases by name; `memory` is the best of them."""
SIX_DIMENSIONS = ("grid_table", "factored_table")
"""Those whose keys the object's direction can join."""
DEFAULTS: dict[str, dict[str, Any]] = {
    "grid_table": {"every_look": False, "servo": "paper_servo", "jump_px": math.inf},
}
"""Settings of agents that bear a knowledge base's name. With the paper's table only success teaches, what is
recalled is always tried, and the paper's servo corrects."""
SB3 = ("sac", "sac_her", "td3", "tqc", "crossq", "ppo", "recurrent_ppo")
"""Learners of stable-baselines3 and sb3_contrib; each is its file in configs/agents."""
SELF_TAUGHT = ("self_supervised", "cooperstock_milios")
"""Networks that teach themselves from their own motions."""
NEURAL = ("recurrent_servo", "sb3", *SB3)
"""Agents that load torch, and need what the extra `agents` of the wheel installs."""

_MAKERS: dict[str, Callable[..., Agent]] = {
    "random": RandomAgent,
    "oracle": Oracle,
    **{name: partial(_servo_agent, servo=name) for name in SERVOS},
    "learning_servo": _learning_servo,
    "safe_start": _safe_start,
    "grasp": _grasp,
    "insert": _insert,
    "yoshimi_allen": YoshimiAllen,
    **{name: partial(_learning_servo, knowledge=name) for name in KNOWLEDGE},
    "body_schema": _body_schema,
    "joint_space_servo": JointSpaceServo,
    "affine_stereo": AffineStereo,
    "model_based": ModelBased,
    "self_calibrating": SelfCalibrating,
    "recurrent_servo": _recurrent_servo,
    "sb3": _sb3,
    **dict.fromkeys(SB3, _sb3),
    **{name: partial(_self_taught, learner=name) for name in SELF_TAUGHT},
}


OF_TASK = {"grasp": ("random", "grasp", "sb3", *SB3), "insert": ("random", "insert", "yoshimi_allen")}
"""Agents that act in an environment whose task is another than to reach."""
_OF_OTHER_TASKS = ("grasp", "insert", "yoshimi_allen")
"""Agents that do nothing else."""
OVER_SERVOS = ("learning_servo", "body_schema", "safe_start", "grasp", "insert")
"""Agents that are laid over a servo, whose settings they take."""
OF_ONE_ARM = ("affine_stereo", "model_based", "self_calibrating")
"""Agents that are built on what the motors of the built-in arm do."""
ARM, ARM_MOTORS = "movemaster", 3
"""Name of that arm, and how many motors it has."""


def names(task: str = "reach") -> tuple[str, ...]:
    """The names that `make` knows of agents that do a task, "reach", "grasp" or "insert".

    Raises:
        ValueError: There is no such task.
    """
    check_choice("task", task, TASKS)
    return OF_TASK.get(task) or tuple(name for name in _MAKERS if name not in _OF_OTHER_TASKS)


def make(name: str, env: Environment, **settings: Any) -> Agent:
    """Makes the agent `name` for `env`.

    Args:
        name: One of `names()`.
        env: The environment that it learns in, and whose spaces it acts in; for a learner of
            stable-baselines3 also a batched one.
        **settings: Of the agent; `seed` for all.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses, a setting that is not allowed, an arm that the
            agent does not know, with the agents that act on any, or no environment with image points.
    """
    _check_name(name)
    try:
        task = task_of(env)
    except ValueError as error:
        raise ValueError(f"agent {name!r}: {error}") from None
    shape = getattr(env.action_space, "shape", None)
    if shape is None or (len(shape) != 1 and _MAKERS[name] is not _sb3):
        raise ValueError(f"agent {name!r} acts in one environment at a time; this one's actions are {shape}")
    _check_arm(name, env)
    with _told_what_to_install(name):
        settings = _defaults(name) | settings
        _known_settings(name, settings)
        if name not in names(task):
            raise ValueError(
                f"agent {name!r} cannot {task}, as this environment asks; allowed: {', '.join(names(task))}"
            )
        try:
            return _MAKERS[name](env, **settings)
        except (TypeError, ValueError) as error:
            raise ValueError(f"agent {name!r}: {error}") from error


def default_settings(name: str, **given: Any) -> dict[str, Any]:
    """What `make(name, env, **given)` makes an agent with; settings without a default only if given.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses, or a setting that is not allowed.
    """
    _check_name(name)
    with _told_what_to_install(name):
        chosen = _defaults(name) | given
        settings = _known_settings(name, chosen) | chosen
    return {setting: value for setting, value in settings.items() if value is not Parameter.empty}


def _known_settings(name: str, chosen: Mapping[str, Any]) -> dict[str, Any]:
    """All settings of an agent and their defaults; raises ValueError where one that is chosen is none."""
    allowed = _settings_of(name, chosen)
    for setting in chosen:
        if setting not in allowed:
            found = f"agent {name!r} has no setting {setting!r}{near_misses(setting, allowed)}"
            raise ValueError(f"{found}; allowed: {', '.join(allowed)}")
    return allowed


def _check_name(name: str) -> None:
    if name not in _MAKERS:
        hint = near_misses(name, _MAKERS)
        raise ValueError(f"unknown agent {name!r}{hint}; allowed: {', '.join(_MAKERS)}")


def _check_arm(name: str, env: Environment) -> None:
    """Raises where an agent knows no other arm than the built-in one, and this is another."""
    spec, motors = getattr(env, "spec", None), env.action_space.shape[-1]  # type: ignore[index]
    arm = spec.kwargs.get("arm", ARM) if spec is not None else ARM
    if name not in OF_ONE_ARM or (isinstance(arm, str) and arm == ARM and motors == ARM_MOTORS):
        return
    of_any = ", ".join(known for known in names() if known not in (*OF_ONE_ARM, "recurrent_servo"))
    raise ValueError(
        f"agent {name!r}: {name} is built on the arm {ARM!r}, and this is another one, of {motors} "
        f"motors; allowed with any arm: {of_any}; recurrent_servo with any of its network's motors"
    )


@contextmanager
def _told_what_to_install(name: str) -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"agent {name!r} needs {error.name}, which is not installed: pip install 'calfree-gym[agents]'",
            name=error.name,
        ) from error


def _defaults(name: str) -> dict[str, Any]:
    """An agent's own defaults."""
    return tuned_settings(name) if name in SB3 else DEFAULTS.get(name, {})


def _settings_of(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that an agent takes, with their defaults (`Parameter.empty`, where there is none).

    A learning servo's depend on the knowledge and servo `given`.
    """
    if _MAKERS[name] is _sb3:
        from .neural.sb3.agent import settings_with

        try:
            return settings_with(given)
        except ValueError as error:
            raise ValueError(f"agent {name!r}: {error}") from error
    if name in SELF_TAUGHT:
        from .neural.self_supervised import AGENTS

        return named_settings(AGENTS[name])
    named = named_settings(_MAKERS[name])
    if name in SERVOS:
        return {"seed": named["seed"], **_fields(name)}
    chosen = {"servo": "unified_servo", "knowledge": "memory", **given}
    if name not in (*KNOWLEDGE, *OVER_SERVOS):
        return named
    if name in KNOWLEDGE:
        named.pop("knowledge")
        chosen["knowledge"] = name
    knows = name not in ("insert", "safe_start", "body_schema") and (
        name != "grasp" or chosen["knowledge"] is not None
    )
    for setting, known in (("servo", SERVOS), ("knowledge", KNOWLEDGE))[: 1 + knows]:
        if chosen[setting] not in tuple(known):
            hint, allowed = near_misses(chosen[setting], known), ", ".join(known)
            raise ValueError(f"agent {name!r}: {setting} is {chosen[setting]!r}{hint}; allowed: {allowed}")
    if not knows:
        return named | _fields(chosen["servo"])
    table = _grasp if chosen.get("direction") else _table
    over = named_settings(_memory if chosen["knowledge"] == "memory" else table)
    settings = named | {setting: over[setting] for setting in over if setting not in ("seed", "knowledge")}
    return settings | _own_settings(chosen["knowledge"]) | _fields(chosen["servo"])


def _fields(servo: str) -> dict[str, Any]:
    return {field.name: field.default for field in fields(SERVOS[servo])}
