"""The interface of every knowledge base: from the object's sensor vector at home to registers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import gymnasium as gym
from numpy.typing import NDArray

from calfree_gym.errors import check_choice

from ..base.agent import Agent
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from ..base.registration import Settings, agent, named_settings
from ..servo.servo_agent import SERVOS, UNIFIED, ServoAgent

K = TypeVar("K")
KNOWLEDGE: dict[str, type[Any]] = {}
"""Knowledge bases by name; `memory` is the best of them."""
_LAID_OVER: dict[str, type[Any]] = {}
"""The agents that lay them over a servo."""


def knowledge_base(
    name: str,
    does: str,
    over_servo: type[KnowledgeAgent],
    defaults: Callable[[Settings], Settings] = lambda given: {},
) -> Callable[[type[K]], type[K]]:
    """Puts a knowledge base under a name, and the agent that lays it over a servo.

    Args:
        name: Of both.
        does: See `NamedAgent`.
        over_servo: The agent's class.
        defaults: See `NamedAgent`.
    """

    def named(base: type[K]) -> type[K]:
        KNOWLEDGE[name], _LAID_OVER[name] = base, over_servo
        agent(name, does, fixed={"knowledge": name}, defaults=defaults)(over_servo)
        return base

    return named


def own_settings(knowledge: str) -> Settings:
    """What a knowledge base takes, and its defaults."""
    settings = named_settings(KNOWLEDGE[knowledge])
    return {name: default for name, default in settings.items() if name not in ("motors", "dimensions")}


def make_knowledge(name: str, motors: int, settings: Settings, **keys: int) -> Any:
    """A knowledge base over registers of so many motors; takes its own settings out of all."""
    own = {each: settings.pop(each) for each in own_settings(name) if each in settings}
    return KNOWLEDGE[name](motors, **own, **keys)


@dataclass(frozen=True)
class Recall:
    """What a knowledge base remembers of a place.

    Attributes:
        registers: Registers (m,) that should bring the gripper to the object.
        deviation_px: The confidence: standard deviation of where it ends up, in the worse image, in pixels.
    """

    registers: Array
    deviation_px: float


class Knowledge(Protocol):
    """Associations between sensor vectors (4,), seen from home, and registers (m,) that lead there."""

    @property
    def prior_knowledge(self) -> frozenset[PriorKnowledge]:
        """What it is built on, see `Agent`."""

    def recall(self, sensors: Array) -> Recall | None:
        """What is remembered of an object seen at `sensors` (4,), from home; None where nothing is."""

    def jacobian(self, registers: Array) -> Array | None:
        """∂sensors/∂registers (4, m) of an object at registers (m,); None where too little is known."""

    def learn(self, sensors: Array, registers: Array) -> None:
        """Takes in that `registers` (m,) bring the gripper to an object seen at `sensors` (4,) from home."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""


class KnowledgeAgent(ServoAgent):
    """Lays a knowledge base over a servo; its constructor takes both, and settings of its own."""

    @classmethod
    def settings(cls, given: Settings) -> Settings:
        """See `Agent`. Those of knowledge and servo are among them."""
        of_servo = ServoAgent.settings(given)
        name = given.get("knowledge", "memory")
        check_choice("knowledge", name, KNOWLEDGE)
        own = {"seed": 0, "knowledge": "memory", "servo": UNIFIED, **named_settings(_LAID_OVER[name])}
        return own | own_settings(name) | of_servo | {"knowledge": "memory"}

    @classmethod
    def make(cls, env: gym.Env[Any, Any], seed: int = 0, servo: str = UNIFIED, **settings: Any) -> Agent:
        """See `Agent`. All other settings are of the agent, of knowledge and of the servo."""
        knowledge = settings.pop("knowledge", "memory")
        kind = _LAID_OVER[knowledge]
        base = make_knowledge(knowledge, env.action_space.shape[0], settings)  # type: ignore[index]
        own = {each: settings.pop(each) for each in named_settings(kind) if each in settings}
        made: Agent = kind(env, base, SERVOS[servo](**settings), seed, **own)
        return made
