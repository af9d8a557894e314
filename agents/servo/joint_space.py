"""The same servo in joint space, with a fixed gain (Conkie & Chongstitvatana 1990)."""

from typing import Any

import gymnasium as gym
import numpy as np

from ..base.checks import check_number
from ..base.observation import Array, Observation
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from .jacobian import TestMotions
from .redundancy import solve
from .servo_agent import SERVO_KNOWLEDGE
from .trial import Findings, ServoTrial


@agent("joint_space_servo", "A servo that sees the joint angles (Conkie, Chongstitvatana 1990).")
class JointSpaceServo(ProcedureAgent):
    """Measures ∂d/∂q by test motions, turns the joints by -gain J⁺ d, repeats.

    From the reference: two uncalibrated cameras, test motions that measure how the image distance d follows
    the joint angles q, and steps of a fixed gain. It needs the calibrated joints that the paper does without
    (section 2.3): the joint angles are a privileged observation. A reconstruction is how it commands joints
    that take nothing but control words: what a word turns a joint by is read off these angles at every
    test motion. That test motions come before every step and are sized by what they do in the images is the
    paper's.

    Args:
        gain: Share of the way to the object that a step is to make, below 1.
        step_rad: No joint turns further in a step.
        damping: Of the least squares, relative to the columns' length.
    """

    privileged = ("joint_angles",)
    prior_knowledge = SERVO_KNOWLEDGE
    FIRST_WORD = 0.04
    """Size of the very first test words: tuned on wild worlds 3000 and up."""
    TEST_PX = 8.0
    """Image displacement wanted of a test motion: tuned likewise."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        gain: float = 0.8,
        step_rad: float = 0.5,
        damping: float = 0.02,
        seed: int = 0,
    ) -> None:
        super().__init__(env, seed)
        self.gain = check_number("gain", gain, above=0, most=1)
        self.step_rad = check_number("step_rad", step_rad, above=0, finite=False)
        self.damping = check_number("damping", damping, least=0)

    @property
    def kind(self) -> str:
        return f"JointSpaceServo(gain={self.gain}, step_rad={self.step_rad}, damping={self.damping})"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        motors = len(first.registers)
        trial = ServoTrial(first, Findings(TestMotions(motors)), self.FIRST_WORD, self.TEST_PX)
        turned_by_word = np.ones(motors)
        yield from trial.begin()
        while True:
            before = trial.now
            for motor in trial.unmeasured():
                yield from trial.test(motor)
            words = trial.now.registers - before.registers
            turned = _angles(trial.now) - _angles(before)
            tested = (words != 0) & (turned != 0)  # at a stop a joint may not turn
            turned_by_word[tested] = turned[tested] / words[tested]
            step = self._step(trial.jacobian / turned_by_word, trial.now.distance)
            yield from trial.move_in_view(step / turned_by_word)
            trial.forget()

    def _step(self, jacobian: Array, distance: Array) -> Array:
        """By how much the joints (m,) are to turn in one step, in rad."""
        wanted = self.gain * solve(jacobian, distance, self.damping)
        return wanted * min(1.0, self.step_rad / max(np.abs(wanted).max(), 1e-9))


def _angles(observation: Observation) -> Array:
    """Angles (m,) of the joints that motors turn."""
    return observation.privileged["joint_angles"][: len(observation.registers)]
