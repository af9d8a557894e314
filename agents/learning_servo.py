"""Recall, move, correct, learn: any knowledge base over any servo (paper, section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
from numpy.typing import NDArray

from agents.agent import Look, Procedure
from agents.jacobian import Estimator
from agents.knowledge.knowledge import Knowledge
from agents.servo import Servo
from agents.servo_agent import ServoAgent


class LearningServo(ServoAgent):
    """Moves at once to where it remembers; corrects by `servo`; remembers where it succeeded.

    It takes a trial for a success where the environment ends it, so it learns nothing from one with
    `terminate_on_success=False`.

    Knowledge is keyed by the object's sensor vector as seen from home and holds registers: that is well
    defined also where the cameras turn with the waist.
    """

    def __init__(self, env: gym.Env[Any, Any], knowledge: Knowledge, servo: Servo, seed: int = 0) -> None:
        super().__init__(env, servo, seed)
        self.knowledge = knowledge

    def seek(self, look: Look, estimator: Estimator) -> Procedure:
        """See `ServoAgent`."""
        registers = self.knowledge.recall(look.object)
        if registers is not None:
            home, look = look, (yield registers - look.registers)
            if not look.visible.all():
                look = yield home.registers - look.registers
        yield from super().seek(look, estimator)

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """See `ProcedureAgent`."""
        super().learn_trial(looks, ended)
        if ended:
            self.knowledge.learn(looks[0].object, looks[-1].registers)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"{self.knowledge!r} over {self.servo!r}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        return super().arrays() | self.knowledge.arrays()

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        super().restore(arrays)
        self.knowledge.restore(arrays)
