"""The same servo in joint space, with a fixed gain (Conkie & Chongstitvatana 1990)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from agents.base.agent import Array, Look, Procedure, ProcedureAgent
from agents.jacobian import TestMotions, distance_jacobian
from agents.servo.redundancy import solve
from agents.servo.trial import Trial


class JointSpaceServo(ProcedureAgent):
    """Measures ∂d/∂q by test motions, turns the joints by -gain J⁺ d, repeats.

    From the reference: two uncalibrated cameras, test motions that measure how the image distance d follows
    the joint angles q, and steps of a fixed gain. It needs the calibrated joints that the paper does without
    (section 2.3): it is told the joint angles after every motion. A reconstruction is how it commands joints
    that take nothing but control words: what a word turns a joint by is read off the told angles at every
    test motion. That test motions come before every step and are sized by what they do in the images is the
    paper's.

    Args:
        gain: Share of the way to the object that a step is to make, below 1.
        step_rad: No joint turns further in a step.
        damping: Of the least squares, relative to the columns' length.
    """

    told = ("joint_angles",)
    FIRST_WORD = 0.04
    TEST_PX = 8.0

    def __init__(
        self,
        env: gym.Env[Any, Any],
        gain: float = 0.8,
        step_rad: float = 0.5,
        damping: float = 0.02,
        seed: int = 0,
    ) -> None:
        super().__init__(env, seed)
        if not 0 < gain <= 1 or not step_rad > 0 or not damping >= 0:
            raise ValueError(
                f"gain is {gain}, step_rad {step_rad}, damping {damping}; gain must be in (0, 1], "
                "step_rad positive, damping not negative"
            )
        self.gain = gain
        self.step_rad = step_rad
        self.damping = damping

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"JointSpaceServo(gain={self.gain}, step_rad={self.step_rad}, damping={self.damping})"

    def procedure(self, look: Look) -> Procedure:
        """See `ProcedureAgent`."""
        trial = Trial(look, TestMotions(len(look.registers)), self.FIRST_WORD, self.TEST_PX)
        turned_by_word = np.ones(len(look.registers))
        yield from trial.begin()
        while True:
            before = trial.look
            yield from trial.test_hidden()
            tested = trial.look.registers != before.registers
            turned = self._angles(trial.look) - self._angles(before)
            words = trial.look.registers - before.registers
            turned_by_word[tested] = turned[tested] / words[tested]
            jacobian = distance_jacobian(trial.estimator.jacobian) / turned_by_word
            yield from trial.move_in_view(self._step(jacobian, trial.look.distance) / turned_by_word)
            trial.forget()

    def _step(self, jacobian: Array, distance: Array) -> Array:
        """By how much the joints (m,) are to turn in one step, in rad."""
        wanted = self.gain * solve(jacobian, distance, self.damping)
        return wanted * min(1.0, self.step_rad / max(np.abs(wanted).max(), 1e-9))

    @staticmethod
    def _angles(look: Look) -> Array:
        """Angles (m,) of the joints that motors turn."""
        return look.told["joint_angles"][: len(look.registers)]
