"""The paper's first implementation: the waist is known, and turns the work plane to the object (section 3.2).

Motor 1 is known to turn the arm about its vertical axis; the others, motors 2 and 3 of the paper's arm, move
the gripper within the work plane. There each camera alone has two equations for two words, by a
sensor-control Jacobian of its own. Of more motors than these, only the two ways that move the images most
are used: an arm whose other axes are not parallel has no work plane, and this servo often misses.
Where their solutions differ, the cameras see the object in different places of the work plane, so it does
not lie in it (figure 6): their disparity tells how far the waist is to turn.

The paper leaves open how. Here the waist's test motion measures what a word of it does to the disparity, and
the disparity is projected on that; both 2-vectors are weighed by how well the Jacobians determine them, for
these may be nearly singular (the arm stretched out) or look along the work plane. With these weights, turn
and motion together are the least-squares solution of all four equations.
"""

from dataclasses import dataclass

import numpy as np

from calfree_gym.errors import check_choice
from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number
from ..base.observation import Array, Observation
from ..base.procedure import Procedure
from .jacobian import Estimator, TestMotions
from .redundancy import solve, solve_within
from .servo_agent import SERVO_KNOWLEDGE, check_motions, servo
from .slopes import Slopes
from .trial import Findings, ServoTrial, Steps

WAIST = 0
RANK = 1e-9
"""Directions of a relative square below this are none (a guard above rounding)."""
EQUATIONS = {"left": slice(0, 2), "right": slice(2, 4), "both": slice(0, 4)}
"""Each camera's among the four."""


def within_plane(jacobian: Array) -> Array:
    """J (4, m) of motions in the work plane: of the motors beside the waist, the two strongest ways alone."""
    ways = np.linalg.svd(jacobian[:, 1:], full_matrices=False)[2][:2]
    return np.column_stack([jacobian[:, WAIST], jacobian[:, 1:] @ ways.T @ ways])


def disparity(jacobian: Array, distance: Array, damping: float) -> Array:
    """The left camera's solution of -d = J c for the words (m - 1,) of motors 2 to m, minus the right one's.

    Args:
        jacobian: Image distance by words (4, m).
        distance: Image distance d (4,); the waist's column in its place gives the disparity's derivative.
        damping: See `redundancy.solve`.
    """
    left, right = (
        solve(jacobian[equations, 1:], distance[equations], damping)
        for equations in (EQUATIONS["left"], EQUATIONS["right"])
    )
    return left - right


def disparity_weight(jacobian: Array) -> Array:
    """Weight (m - 1, m - 1) of a disparity: the inverse of its covariance, for image points of unit noise.

    A disparity δ has the length √(δᵀWδ): the image distance (norm over both cameras, in image units)
    that no motion in the work plane can remove.
    """
    left, right = (jacobian[EQUATIONS[camera], 1:] for camera in ("left", "right"))
    left, right = left.T @ left, right.T @ right
    return np.asarray(left @ np.linalg.pinv(left + right, hermitian=True, rcond=RANK) @ right)


def turn(jacobian: Array, distance: Array, damping: float) -> float:
    """The waist's word that makes the disparity as small as it can, if the world were linear.

    Args:
        jacobian: Image distance by words (4, m).
        distance: Image distance d (4,).
        damping: See `redundancy.solve`.

    Returns:
        The word; 0 where the waist's column is zero.
    """
    now = disparity(jacobian, distance, damping)
    by_word = disparity(jacobian, jacobian[:, WAIST], damping)
    weighed = disparity_weight(jacobian) @ by_word
    square = float(by_word @ weighed)
    return -float(now @ weighed) / square if square > 0 else 0.0


@servo("work_plane_servo", "The paper's first servo: turns the waist, then moves in the work plane.")
@dataclass(frozen=True)
class WorkPlaneServo:
    """Turns the work plane to the object, moves the gripper within it, and repeats.

    Each round measures the columns of motors 2 to m anew by test motions, and the waist's only where a turn
    is needed. After a turn, the motion in the plane uses the columns measured before it. The numbers below
    were tuned on wild worlds 3000 and up.

    As turn and motion together solve all four equations, it hardly matters whether motor 1 does turn the
    waist: with motors in another order it needs 1 to 8 % more motions (`experiments.studies.priors`).

    Attributes:
        camera: Whose solution moves the gripper within the work plane: "left", "right", or the mean of
            "both", each weighed by how well its Jacobian determines it. The paper: either one may be used.
        first_word: Size of the very first test word.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        damping: Of each solution, relative to the columns' length.
        border: Steps are predicted to keep every point within this part of the images.
        in_plane_px: The object counts as in the work plane where the disparity, turned into an image distance
            by `disparity_weight`, is shorter than this.
    """

    camera: str = "both"
    first_word: float = 0.04
    test_px: float = 16.0
    step_px: float = 120.0
    step_word: float = 0.7
    damping: float = 0.05
    border: float = 0.95
    in_plane_px: float = 2.0

    prior_knowledge = SERVO_KNOWLEDGE

    def __post_init__(self) -> None:
        check_choice("camera", self.camera, EQUATIONS)
        check_motions(self)
        check_number("in_plane_px", self.in_plane_px, least=0)

    def new_estimator(self, motors: int, start: Slopes | None) -> Estimator:
        return TestMotions(motors, start)

    def __call__(self, first: Observation, findings: Findings[Estimator]) -> Procedure:
        """Seeks the rendezvous from the first observation on, until the trial ends."""
        trial = ServoTrial(first, findings, self.first_word, self.test_px)
        steps = Steps(trial, self.step_px, self.step_word, self.border)
        yield from trial.begin()
        while True:
            trial.forget()
            for motor in trial.unmeasured():
                if motor != WAIST:
                    yield from trial.test(motor)
            if not trial.still[WAIST] and not self._in_plane(trial):
                yield from trial.test(WAIST)
                yield from steps.make(self._turn(trial))
            yield from steps.make(self._motion_in_plane(trial))

    def _in_plane(self, trial: ServoTrial) -> bool:
        jacobian = within_plane(trial.jacobian)
        apart = disparity(jacobian, trial.now.distance, self.damping)
        squared = float(apart @ disparity_weight(jacobian) @ apart)
        return squared < (self.in_plane_px * IMAGE_UNIT) ** 2

    def _turn(self, trial: ServoTrial) -> Array:
        """Control words (m,) that bring the object into the work plane."""
        lowest, highest = trial.word_bounds
        word = turn(within_plane(trial.jacobian), trial.now.distance, self.damping)
        words = np.zeros_like(lowest)
        words[WAIST] = np.clip(word, lowest[WAIST], highest[WAIST])
        return words

    def _motion_in_plane(self, trial: ServoTrial) -> Array:
        """Control words (m,) that bring the gripper to an object in the work plane."""
        equations = EQUATIONS[self.camera]
        lowest, highest = trial.word_bounds
        jacobian, distance = within_plane(trial.jacobian)[equations, 1:], trial.now.distance[equations]
        return np.array([0.0, *solve_within(jacobian, distance, self.damping, lowest[1:], highest[1:])])
