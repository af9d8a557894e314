"""Recall, move, correct, learn: any knowledge base over any servo (paper, section 4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_choice, check_flag

from ..base.agent import Agent
from ..base.checks import check_number, checked_array
from ..base.observation import Array, Observation, RawObservation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure
from ..base.registers import at_home
from ..base.registration import KNOWLEDGE, SERVOS, Settings, agent, named_settings
from ..base.storage import with_present_names
from ..servo.jacobian import distance_jacobian
from ..servo.redundancy import solve
from ..servo.servo_agent import UNIFIED, Servo, ServoAgent
from ..servo.slopes import Slopes
from ..servo.trial import Findings, jump

K = TypeVar("K")
_LAID_OVER: dict[str, type[Any]] = {}
"""The agents that lay them over a servo."""


def knowledge_base(
    name: str,
    does: str,
    over_servo: type[KnowledgeAgent],
    defaults: Callable[[Settings], Settings] = lambda given: {},
) -> Callable[[type[K]], type[K]]:
    """Puts a knowledge base under a name, and the agent that lays it over a servo, see `NamedAgent`."""

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


@agent("learning_servo", "Any knowledge base over any servo (`knowledge=`, `servo=`).")
class LearningServo(KnowledgeAgent):
    """Moves at once to where it remembers; corrects by `servo`; remembers where it succeeded.

    It takes a trial for a success where the environment ends it, so it learns no rendezvous from one with
    `terminate_on_success=False`.

    Knowledge is keyed by the object's sensor vector as seen from home and holds registers: that is well
    defined also where the cameras turn with the waist.

    Attributes:
        camera_motors: Which motors (m,) move the cameras: they move the object's image, not the gripper's.
        looks_teach: Whether every observation of the gripper teaches. Where a motor moves both images, as
            where the cameras are on the forearm, it does not show where an object would be seen from home.

    Args:
        knowledge: The knowledge base.
        servo: Corrects where it misses.
        jump_px: It moves at once only where it expects to end up no further off than this; tuned on
            wild worlds 3000 and up.
        every_look: Whether every observation of the gripper teaches, not only the rendezvous.
    """

    BOTH = 0.2
    """A motor moves both images where it moves one by more than this share of the other. Choice: where the
    cameras are on the waist, motors move one of them."""
    LATE_PX = 6.0
    """A last observation with a larger image distance is taken for a late one: its registers are stored
    without correction. Derived for `tolerance_px=4`: 4 + 3 · 0.5, rounded up. With a larger tolerance many
    true successes stay uncorrected."""

    DAMPING = 0.05
    """Of the least squares that tell where they would have met: that of the servos."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        knowledge: Knowledge,
        servo: Servo,
        seed: int = 0,
        jump_px: float = 60.0,
        every_look: bool = True,
    ) -> None:
        super().__init__(env, servo, seed)
        check_number("jump_px", jump_px, least=0, finite=False)
        check_flag("every_look", every_look)
        self.knowledge = knowledge
        self.prior_knowledge |= knowledge.prior_knowledge
        self.jump_px = jump_px
        self.every_look = every_look
        self.looks_teach = every_look
        self.camera_motors = np.zeros(self.motors, bool)

    def procedure(self, first: Observation, findings: Findings[Any]) -> Procedure:
        now = yield from findings.filter.first(first)
        findings.trusted.append(now)
        recall = self._recall(now)
        if recall is not None:
            now = yield from jump(recall.registers, now, findings)
        findings.estimator = self.servo.new_estimator(self.motors, self._slopes_at(now.registers))
        yield from self.servo(now, findings)

    def _slopes_at(self, registers: Array) -> Slopes | None:
        """The Jacobian that knowledge implies at registers (m,), else that of the last trial's beginning."""
        jacobian = self.implied_jacobian(registers)
        if jacobian is not None:
            return Slopes.of(jacobian, registers)
        return self.slopes and self.slopes._replace(registers=registers)

    def expected_px(self, first: RawObservation) -> float | None:
        """How far off it expects to be after its first motion, told before that motion is made.

        Args:
            first: What a trial begins with.

        Returns:
            The standard deviation in the worse image, in pixels; None where it knows too little to move at
            once, or does not see the object.
        """
        home = at_home(Observation.of(first))
        recall = self._recall(home) if home.visible.all() else None
        return None if recall is None else recall.deviation_px

    def _recall(self, home: Observation) -> Recall | None:
        """What it remembers of the object's place, if that is seen, and sure enough to move there at once."""
        recall = self.knowledge.recall(home.object) if home.shows_object else None
        return None if recall is None or recall.deviation_px > self.jump_px else recall

    def learn_trial(self, findings: Findings[Any], last: Observation, ended: bool) -> None:
        super().learn_trial(findings, last, ended)
        self._learn_camera_motors(findings.estimator.jacobian)
        trusted = findings.trusted
        if not trusted:
            return
        registers = [np.where(self.camera_motors, 0.0, each.registers) for each in trusted]
        sensors = [each.gripper for each in trusted]
        teaches = [self.looks_teach and each.shows_gripper for each in trusted]
        registers.append(self._rendezvous(last, findings.estimator.jacobian if len(trusted) > 2 else None))
        sensors.append(trusted[0].object)
        teaches.append(ended and trusted[0].shows_object)
        for seen, there, teach in zip(sensors, registers, teaches, strict=True):
            if teach:
                self.knowledge.learn(seen, there)

    def _learn_camera_motors(self, jacobian: Array) -> None:
        """Tells by J (8, m), once all motors are in it, which of them move the object's image more."""
        if jacobian.any(0).all():
            gripper, object_ = np.sqrt(np.square(jacobian).reshape(2, 4, -1).sum(1))
            self.camera_motors = object_ > gripper
            both = np.minimum(gripper, object_) > self.BOTH * np.maximum(gripper, object_)
            self.looks_teach = self.every_look and not both.any()

    def _rendezvous(self, last: Observation, jacobian: Array | None) -> Array:
        """Registers (m,) at which gripper and object would have met exactly: c* = c - J⁺ d.

        None where the trial has shown nothing of J: as it usually is, it is too wrong for that.
        """
        if jacobian is None or last.distance_px > self.LATE_PX:
            return last.registers
        return last.registers + solve(distance_jacobian(jacobian), last.distance, self.DAMPING)

    def implied_jacobian(self, registers: Array) -> Array | None:
        """The Jacobian (8, m) of gripper and object points that its knowledge implies at `registers`.

        Motors that move the cameras leave the gripper's image where it is, and move the object's the
        opposite way.
        """
        jacobian = self.knowledge.jacobian(np.where(self.camera_motors, 0.0, registers))
        if jacobian is None:
            return None
        return np.concatenate([jacobian * ~self.camera_motors, -jacobian * self.camera_motors])

    @property
    def kind(self) -> str:
        settings = f"jump_px={self.jump_px:g}, every_look={self.every_look}"
        return f"{self.knowledge!r} over {self.servo!r}, {settings}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        motors = {"camera_motors": self.camera_motors, "looks_teach": np.array([self.looks_teach])}
        return super().arrays() | self.knowledge.arrays() | motors

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        super().restore(arrays)
        arrays = with_present_names(arrays, {"carriers": "camera_motors"})
        self.knowledge.restore(arrays)
        self.camera_motors = checked_array(arrays, "camera_motors", (self.motors,)) > 0
        if "looks_teach" in arrays:
            self.looks_teach = bool(checked_array(arrays, "looks_teach", (1,))[0])
