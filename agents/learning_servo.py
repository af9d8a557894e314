"""Recall, move, correct, learn: any knowledge base over any servo (paper, section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.agent import Array, Look, Procedure
from agents.jacobian import Estimator, distance_jacobian
from agents.knowledge.knowledge import Knowledge
from agents.redundancy import solve
from agents.servo import Servo
from agents.servo_agent import ServoAgent


class LearningServo(ServoAgent):
    """Moves at once to where it remembers; corrects by `servo`; remembers where it succeeded.

    It takes a trial for a success where the environment ends it, so it learns nothing from one with
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
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        knowledge: Knowledge,
        servo: Servo,
        seed: int = 0,
        jump_px: float = 60.0,
        every_look: bool = True,
        on_change: str = "recognise",
    ) -> None:
        super().__init__(env, servo, seed)
        self.knowledge = knowledge
        self.jump_px = jump_px
        self.every_look = every_look
        from agents.knowledge.recognition import Recognition
        self.recognition=Recognition(knowledge,on_change)
        self.carriers = np.zeros(env.action_space.shape, bool)

    def seek(self, look: Look, estimator: Estimator) -> Procedure:
        """See `ServoAgent`."""
        knowledge = self.knowledge
        if not self.recognition.as_ever(look.gripper):
            back = self.recognition.recollected(look.gripper)
            if back is None:
                yield from super().seek(look, estimator)
                return
            knowledge = back
        recall = knowledge.recall(look.object)
        if recall is not None and recall.deviation_px <= self.jump_px:
            home, look = look, (yield recall.registers - look.registers)
            if not look.visible.all():
                look = yield home.registers - look.registers
        if (jacobian := self._implied(look.registers, knowledge)) is not None:
            estimator.restart(jacobian)
        yield from super().seek(look, estimator)

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """See `ProcedureAgent`."""
        super().learn_trial(looks, ended)
        if self.jacobian is not None:
            gripper, object_ = np.square(self.jacobian).reshape(2, 4, -1).sum(1)
            self.carriers = object_ > gripper
        pairs = [
            (np.where(self.carriers, 0.0, look.registers), look.gripper)
            for look in looks
            if look.visible[:2].all()
        ]
        if ended:
            pairs.append((self._rendezvous(looks[-1]), looks[0].object))
        self.recognition.learn(*map(np.array, zip(*pairs)))

    def _rendezvous(self, look: Look) -> Array:
        """Registers (m,) at which gripper and object would have met exactly, from the last look."""
        if self.jacobian is None:
            return look.registers
        return look.registers + solve(distance_jacobian(self.jacobian), look.distance, 0.0)

    def _implied(self, registers: Array, knowledge) -> Array | None:
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
        return f"{self.knowledge!r} over {self.servo!r}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        return super().arrays() | self.knowledge.arrays() | {"carriers": self.carriers}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        super().restore(arrays)
        self.knowledge.restore(arrays)
        self.carriers = np.array(arrays["carriers"])
