"""How each agent is made, of an environment and its settings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym

from calfree_gym.errors import check_choice, check_flag

from ..adaptation.memory import Memory
from ..adaptation.remembered import Remembered
from ..base.agent import Agent
from ..base.settings import named_settings
from ..body_schema.agent import BodySchema
from ..calibrated.affine_stereo import AffineStereo
from ..calibrated.model_based import ModelBased
from ..calibrated.self_calibrating import SelfCalibrating
from ..grasp.agent import Grasp
from ..grasp.inserting.agent import Insert
from ..grasp.inserting.yoshimi_allen import YoshimiAllen
from ..knowledge.factored_table import FactoredTable
from ..knowledge.grid_table import GridTable
from ..knowledge.learning_servo import LearningServo
from ..knowledge.support_points import SupportPoints
from ..reference.oracle import Oracle
from ..reference.random_agent import RandomAgent
from ..servo import SERVOS, make_servo
from ..servo.joint_space import JointSpaceServo
from ..servo.safe.agent import SafeStart
from ..servo.servo_agent import ServoAgent

Environment = gym.Env[Any, Any]


def _make_servo_agent(env: Environment, seed: int = 0, *, servo: str, **settings: Any) -> Agent:
    return ServoAgent(env, make_servo(servo, settings), seed)


def _make_safe_start(env: Environment, seed: int = 0, servo: str = "unified_servo", **settings: Any) -> Agent:
    return SafeStart(env, make_servo(servo, settings), seed)


def _make_body_schema(
    env: Environment, seed: int = 0, servo: str = "unified_servo", **settings: Any
) -> Agent:
    return BodySchema(env, make_servo(servo, settings), seed)


def _make_learning_servo(
    env: Environment, seed: int = 0, knowledge: str = "memory", **settings: Any
) -> Agent:
    maker = make_memory if knowledge == "memory" else make_table
    return maker(env, seed, knowledge, **settings)


def make_table(
    env: Environment,
    seed: int,
    knowledge: str,
    servo: str = "unified_servo",
    jump_px: float = 60.0,
    every_look: bool = True,
    **settings: Any,
) -> Agent:
    """A table over a servo: `knowledge` is one of `KNOWLEDGE` but "memory"; other settings are of both."""
    table = _knowledge(env.action_space.shape[0], knowledge, settings)  # type: ignore[index]
    return LearningServo(env, table, make_servo(servo, settings), seed, jump_px, every_look)


def make_memory(
    env: Environment,
    seed: int,
    knowledge: str,
    servo: str = "unified_servo",
    jump_px: float = 60.0,
    on_change: str = "recognise",
    **settings: Any,
) -> Agent:
    """A memory over a servo; other settings are of both."""
    remembered = _knowledge(env.action_space.shape[0], knowledge, settings)  # type: ignore[index]
    return Memory(env, remembered, make_servo(servo, settings), seed, jump_px, on_change)


def _knowledge(motors: int, name: str, settings: dict[str, Any], **keys: int) -> Any:
    """A knowledge base by its name, over registers of so many motors; takes its own from the settings."""
    own = {each: settings.pop(each) for each in knowledge_settings(name) if each in settings}
    return KNOWLEDGE[name](motors, **own, **keys)


def knowledge_settings(knowledge: str) -> dict[str, Any]:
    """What a knowledge base takes, and its defaults."""
    settings = named_settings(KNOWLEDGE[knowledge])
    return {name: default for name, default in settings.items() if name not in ("motors", "dimensions")}


def make_grasp(
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
    """A grasp over a servo, with knowledge or without (None); other settings are of both."""
    check_flag("direction", direction)
    table = None
    if direction:
        check_choice("knowledge", knowledge, SIX_DIMENSIONS)
        turned = env.action_space.shape[0] - 1  # type: ignore[index]
        table, knowledge = _knowledge(turned, str(knowledge), settings, dimensions=6), None
    own = {"servo": servo} | settings
    reacher = partial(_make_servo_agent, seed=seed, **own)
    if knowledge is not None:
        reacher = partial(_make_learning_servo, seed=seed, knowledge=knowledge, **own)
    return Grasp(env, reacher, intermediate, orientation, tries, seed, table)


def _make_insert(env: Environment, seed: int = 0, servo: str = "unified_servo", **settings: Any) -> Agent:
    return Insert(env, partial(_make_servo_agent, seed=seed, servo=servo, **settings), seed)


def make_sb3(env: Environment, seed: int = 0, **settings: Any) -> Agent:
    """A learner of stable-baselines3 or sb3_contrib."""
    from ..neural.sb3.agent import Sb3Agent

    return Sb3Agent(env, seed, **settings)


def _make_self_taught(env: Environment, seed: int = 0, *, learner: str, **settings: Any) -> Agent:
    from ..neural.self_supervised import AGENTS

    return AGENTS[learner](env, seed, **settings)


def _make_recurrent_servo(env: Environment, seed: int = 0, weights: str | None = None) -> Agent:
    from ..neural.recurrent_servo.agent import RecurrentServo

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
SB3 = ("sac", "sac_her", "td3", "tqc", "crossq", "ppo", "recurrent_ppo")
"""Learners of stable-baselines3 and sb3_contrib; each is its file in configs/agents."""
SELF_TAUGHT = ("self_supervised", "cooperstock_milios")
"""Networks that teach themselves from their own motions."""
MAKERS: dict[str, Callable[..., Agent]] = {
    "random": RandomAgent,
    "oracle": Oracle,
    **{name: partial(_make_servo_agent, servo=name) for name in SERVOS},
    "learning_servo": _make_learning_servo,
    "safe_start": _make_safe_start,
    "grasp": make_grasp,
    "insert": _make_insert,
    "yoshimi_allen": YoshimiAllen,
    **{name: partial(_make_learning_servo, knowledge=name) for name in KNOWLEDGE},
    "body_schema": _make_body_schema,
    "joint_space_servo": JointSpaceServo,
    "affine_stereo": AffineStereo,
    "model_based": ModelBased,
    "self_calibrating": SelfCalibrating,
    "recurrent_servo": _make_recurrent_servo,
    "sb3": make_sb3,
    **dict.fromkeys(SB3, make_sb3),
    **{name: partial(_make_self_taught, learner=name) for name in SELF_TAUGHT},
}
