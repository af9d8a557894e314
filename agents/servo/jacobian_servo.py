"""A Jacobian that is kept up to date by every motion, as others have done where the paper tests motors.

Hosoda & Asada (1994), Jägersand (1997), Piepmeier et al. (1999), Qian & Su (2002), Farahmand et al. (2007).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calfree_gym.errors import check_choice

from ..base.checks import check_number
from ..base.observation import Observation
from ..base.procedure import Procedure
from .jacobian import ESTIMATORS, Estimator
from .redundancy import REDUNDANCIES
from .servo_agent import SERVO_KNOWLEDGE, check_motions, servo
from .slopes import Slopes
from .trial import Findings, ServoTrial, Steps, solve_distance


@servo("jacobian_servo", "Tests each motor once, then corrects its Jacobian by every motion.")
@dataclass(frozen=True)
class JacobianServo:
    """Solves -d = J c°, executes, repeats; an estimator keeps J up to date by every motion.

    Test motions are made of motors of which nothing is known, and of all where steps no longer bring the
    gripper nearer. The settings below were tuned on wild worlds 3000 and up.

    Attributes:
        estimator: How J is estimated: a name of `agents.servo.jacobian.ESTIMATORS`.
        redundancy: What is done with four equations for three words: one of
            `agents.servo.redundancy.REDUNDANCIES`.
        first_word: Size of the very first test word.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        damping: Of the least squares, relative to the columns' length.
        border: Steps are predicted to keep every point within this part of the images.
        patience: After this many steps without coming nearer, J is measured anew.
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

    prior_knowledge = SERVO_KNOWLEDGE

    NEARER: ClassVar[float] = 0.8
    """A step came nearer that left less than this share of the least distance so far: tuned likewise."""
    ARRIVED_PX: ClassVar[float] = 6.0
    """Only a longer distance is worth new test motions. Derived: the usual tolerance of 4 px and three times
    the noise of a good marker, 4 + 3 · 0.7, rounded."""
    DOUBTFUL: ClassVar[float] = 4.0
    """And only one of this many times the blur of points: tuned likewise."""
    DOUBT: ClassVar[float] = 0.3
    """J is then taken to be wrong by that share of its columns: tuned likewise."""

    def __post_init__(self) -> None:
        check_choice("estimator", self.estimator, ESTIMATORS)
        check_choice("redundancy", self.redundancy, REDUNDANCIES)
        check_motions(self)
        check_number("patience", self.patience, least=1)

    def new_estimator(self, motors: int, start: Slopes | None) -> Estimator:
        return ESTIMATORS[self.estimator](motors, start)

    def __call__(self, first: Observation, findings: Findings[Estimator]) -> Procedure:
        """Seeks the rendezvous from the first observation on, until the trial ends."""
        trial = ServoTrial(first, findings, self.first_word, self.test_px)
        steps = Steps(trial, self.step_px, self.step_word, self.border)
        nearest, steps_since = np.inf, 0
        yield from trial.begin()
        while True:
            for motor in trial.unmeasured():
                yield from trial.test(motor)
            yield from steps.make(solve_distance(trial, self.redundancy, self.damping))
            distance = trial.now.distance_px
            came_nearer = distance < self.NEARER * nearest
            nearest, steps_since = (distance, 0) if came_nearer else (nearest, steps_since + 1)
            if trial.object_jumped:
                trial.forget()
            elif steps_since >= self.patience and distance > self._doubtful_px(trial):
                trial.forget(self.DOUBT)
            else:
                continue
            nearest, steps_since = distance, 0

    def _doubtful_px(self, trial: ServoTrial) -> float:
        """The distance beyond which a servo that comes no nearer doubts its Jacobian."""
        return max(self.ARRIVED_PX, self.DOUBTFUL * trial.estimator.blur_px)
