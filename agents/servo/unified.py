"""The paper's second implementation: all motors treated alike (section 3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from agents.base.agent import Array, Look, Procedure
from agents.jacobian import ESTIMATORS, Estimator, displacement_px, distance_jacobian
from agents.servo.redundancy import REDUNDANCIES, solve_within
from agents.servo.settings import check_motions, check_numbers, check_one_of
from agents.servo.steps import Steps
from agents.servo.trial import Trial


@dataclass(frozen=True)
class UnifiedServo:
    """Solves -d = J c°, executes, repeats.

    With `estimator="test_motions"` it is the paper's: J is forgotten after each step and measured anew. Other
    estimators keep J up to date by the steps themselves, and test motions come back only where steps no
    longer bring the gripper nearer.

    Attributes:
        estimator: How J is estimated: a name of `agents.jacobian.ESTIMATORS`.
        redundancy: What is done with four equations for three words: one of
            `agents.servo.redundancy.REDUNDANCIES`.
        first_word: Size of the very first test word.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        damping: Of the least squares, relative to the columns' length.
        border: Steps are predicted to keep every point within this part of the images.
        patience: After so many steps without coming a fifth nearer, J is measured anew.
    """

    estimator: str = "kalman"
    redundancy: str = "weighted"
    first_word: float = 0.04
    test_px: float = 16.0
    step_px: float = 120.0
    step_word: float = 0.7
    damping: float = 0.05
    border: float = 0.95
    patience: int = 6

    ARRIVED_PX: ClassVar[float] = 6.0
    DOUBTFUL: ClassVar[float] = 4.0
    """A distance longer than that, and than so many times the blur of points, is worth new test motions."""
    DOUBT: ClassVar[float] = 0.3
    """J is then taken to be wrong by that share of its columns."""

    def __post_init__(self) -> None:
        check_one_of(self, "estimator", ESTIMATORS)
        check_one_of(self, "redundancy", REDUNDANCIES)
        check_motions(self)
        check_numbers(self, patience=1)

    def __call__(self, look: Look, estimator: Estimator) -> Procedure:
        """Seeks the rendezvous from `look` on, for as long as it is asked."""
        trial = Trial(look, estimator, self.first_word, self.test_px)
        steps = Steps(trial, self.step_px, self.step_word, self.border)
        nearest, steps_since = np.inf, 0
        yield from trial.begin()
        while True:
            yield from trial.test_hidden()
            yield from steps.make(self._words(trial))
            distance = displacement_px(trial.look.distance)
            nearest, steps_since = (distance, 0) if distance < 0.8 * nearest else (nearest, steps_since + 1)
            doubtful = max(self.ARRIVED_PX, self.DOUBTFUL * estimator.blur_px)
            if not estimator.lasting or trial.object_jumped:
                trial.forget()
            elif steps_since >= self.patience and distance > doubtful:
                trial.forget(self.DOUBT)
            else:
                continue
            nearest, steps_since = distance, 0

    def _words(self, trial: Trial) -> Array:
        """Control words (m,) that would bring the gripper to the object if the world were linear."""
        look = trial.look
        jacobian = distance_jacobian(trial.estimator.jacobian)
        equations = REDUNDANCIES[self.redundancy](jacobian, look.distance, trial.estimator.noise_px)
        return solve_within(
            *equations, self.damping, trial.lowest - look.registers, trial.highest - look.registers
        )
