"""Recall, move, correct, learn: any knowledge base over any servo (paper, section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.adaptation.adaptive_knowledge import AdaptiveKnowledge
from agents.base.agent import Array, Look, Procedure
from agents.base.checks import fitting
from agents.jacobian import Estimator, both_points, displacement_px, distance_jacobian
from agents.knowledge.interface import Knowledge
from agents.perception.observation_filter import Senses
from agents.servo import Servo
from agents.servo.redundancy import solve
from agents.servo.servo_agent import ServoAgent


class LearningServo(ServoAgent):
    """Moves at once to where it remembers; corrects by `servo`; remembers where it succeeded.

    It takes a trial for a success where the environment ends it, so it learns no rendezvous from one with
    `terminate_on_success=False`.

    Knowledge is keyed by the object's sensor vector as seen from home and holds registers: that is well
    defined also where the cameras turn with the waist.

    Attributes:
        carriers: Which motors (m,) carry the cameras: they move the object's image, not the gripper's.

    Args:
        env: See `Agent`.
        knowledge: The knowledge base.
        servo: Corrects where it misses.
        seed: See `Agent`.
        jump_px: It moves at once only where it expects to end up no further off than this.
        every_look: Whether every look at the gripper teaches, not only the rendezvous.
        on_change: What it does with its knowledge where the world has changed: one of
            `agents.adaptation.adaptive_knowledge.ON_CHANGE`.
    """

    LATE_PX = 6.0
    """Where gripper and object are seen further apart at the end of a trial, that look came late."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        knowledge: Knowledge,
        servo: Servo,
        seed: int = 0,
        jump_px: float = 60.0,
        every_look: bool = True,
        on_change: str = "keep",
    ) -> None:
        super().__init__(env, servo, seed)
        (motors,) = env.action_space.shape  # type: ignore[misc]
        if isinstance(jump_px, bool) or not isinstance(jump_px, int | float) or not jump_px >= 0:
            raise ValueError(f"jump_px is {jump_px!r}; it must be a number, 0 or more")
        if not isinstance(every_look, bool):
            raise ValueError(f"every_look is {every_look!r}; allowed: True, False")
        if on_change != "keep" and not every_look:
            raise ValueError(
                f"on_change {on_change!r} needs every_look: by looks at the gripper changes show"
            )
        self.recognition = AdaptiveKnowledge(knowledge, motors, on_change)
        self.jump_px = jump_px
        self.every_look = every_look
        self.carriers = np.zeros(motors, bool)

    @property
    def knowledge(self) -> Knowledge:
        """What it remembers."""
        return self.recognition.knowledge

    def seek(self, look: Look, estimator: Estimator) -> Procedure:
        """See `ServoAgent`."""
        senses = Senses()
        look = yield from senses.first(look)
        estimator.trusted.append(look)
        knowledge = self.recognition.knowledge_for(look.gripper)
        if knowledge is not None:
            recall = knowledge.recall(look.object)
            if recall is not None and recall.deviation_px <= self.jump_px:
                home, look = look, (yield recall.registers - look.registers)
                as_seen = both_points(look) - both_points(home)
                look = yield from senses.settle(look, home, as_seen, np.zeros(4, bool))
                estimator.trusted.append(look)
                if not look.visible.all():
                    look = yield home.registers - look.registers
            jacobian = self.implied_jacobian(knowledge, look.registers)
            if jacobian is not None:
                estimator.restart(jacobian)
        yield from super().seek(look, estimator)

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """See `ProcedureAgent`."""
        estimator = self.learn_jacobian(looks)
        jacobian = estimator.jacobian
        if jacobian.any(0).all():
            gripper, object_ = np.square(jacobian).reshape(2, 4, -1).sum(1)
            self.carriers = object_ > gripper
        trusted = estimator.trusted
        if not trusted:
            return
        registers = [np.where(self.carriers, 0.0, look.registers) for look in trusted]
        sensors = [look.gripper for look in trusted]
        taught = [self.every_look and bool(look.visible[:2].all()) for look in trusted]
        registers.append(self._rendezvous(looks[-1]))
        sensors.append(trusted[0].object)
        taught.append(ended and bool(trusted[0].visible[2:].all()))
        self.recognition.learn(np.array(registers)[taught], np.array(sensors)[taught])

    def _rendezvous(self, look: Look) -> Array:
        """Registers (m,) at which gripper and object would have met exactly, from the last look."""
        if self.jacobian is None or displacement_px(look.distance) > self.LATE_PX:
            return look.registers
        return look.registers + solve(distance_jacobian(self.jacobian), look.distance, 0.0)

    def implied_jacobian(self, knowledge: Knowledge, registers: Array) -> Array | None:
        """The Jacobian (8, m) of gripper and object points that knowledge implies at `registers`.

        Motors that carry the cameras leave the gripper's image where it is, and move the object's the
        opposite way.
        """
        jacobian = knowledge.jacobian(np.where(self.carriers, 0.0, registers))
        if jacobian is None:
            return None
        return np.concatenate([jacobian * ~self.carriers, -jacobian * self.carriers])

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        settings = f"jump_px={self.jump_px:g}, every_look={self.every_look}"
        on_change = self.recognition.on_change
        return f"{self.knowledge!r} over {self.servo!r}, {settings}, on_change={on_change}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        return super().arrays() | self.recognition.arrays() | {"carriers": self.carriers}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        super().restore(arrays)
        self.recognition.restore(arrays)
        self.carriers = fitting(arrays, "carriers", self.carriers.shape) > 0
