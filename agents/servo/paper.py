"""The paper's second implementation: all motors alike, test motions before every step (section 3.2)."""

from dataclasses import dataclass

from calfree_gym.errors import check_choice

from ..base.observation import Observation
from ..base.procedure import Procedure
from .jacobian import Estimator, TestMotions
from .redundancy import REDUNDANCIES
from .servo_agent import SERVO_KNOWLEDGE, check_motions, servo
from .slopes import Slopes
from .trial import Findings, ServoTrial, Steps, solve_distance


@servo("paper_servo", "The paper's servo: tests each motor, solves for the step, executes it, and forgets.")
@dataclass(frozen=True)
class PaperServo:
    """Tests each motor, solves -d = J c° (equation 1), executes c°, and counts every column as unknown again.

    So it is "completely insensitive to parameter changes between motion steps" (section 4.1): what a column
    was only chooses the sign and the size of its next test word. The paper gives no numbers: the sizes of
    words and steps below are reconstructions, tuned on wild worlds 3000 and up.

    Attributes:
        redundancy: What is done with four equations for three words: one of
            `agents.servo.redundancy.REDUNDANCIES`.
        first_word: Size of the very first test word.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        damping: Of the least squares, relative to the columns' length.
        border: Steps are predicted to keep every point within this part of the images.
    """

    redundancy: str = "weighted"
    first_word: float = 0.04
    test_px: float = 16.0
    step_px: float = 120.0
    step_word: float = 0.7
    damping: float = 0.05
    border: float = 0.95

    prior_knowledge = SERVO_KNOWLEDGE

    def __post_init__(self) -> None:
        check_choice("redundancy", self.redundancy, REDUNDANCIES)
        check_motions(self)

    def new_estimator(self, motors: int, start: Slopes | None) -> Estimator:
        return TestMotions(motors, start)

    def __call__(self, first: Observation, findings: Findings[Estimator]) -> Procedure:
        """Seeks the rendezvous from the first observation on, until the trial ends.

        What it calls stands in this folder, in `trial`, `perception`, `jacobian` and `redundancy`:

            trial.begin       looks until all points were seen: ObservationFilter.first
            trial.unmeasured  the motors whose columns of J are unknown
            trial.test        a test motion of one motor, of a size that stands out from noise, by
                trial.move    sends control words to the robot by a `yield`, which returns the observation
                              after the motion; ObservationFilter.settle tells which points to believe;
                              TestMotions.learn takes the column: displacement by word
            solve_distance    c° from -d = J c° and what is done with the redundancy, between motors' stops
            steps.make        executes c°, as long as the images allow, by trial.move; goes back where a
                              point got lost
            trial.forget      takes all columns for unknown
        """
        trial = ServoTrial(first, findings, self.first_word, self.test_px)
        steps = Steps(trial, self.step_px, self.step_word, self.border, doubting=True)
        yield from trial.begin()
        while True:
            for motor in trial.unmeasured():
                yield from trial.test(motor)
            yield from steps.make(solve_distance(trial, self.redundancy, self.damping))
            trial.forget()
