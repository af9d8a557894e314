"""What is seen of an object that lies, and how far it was pushed meanwhile."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.observation import Array, Flags
from ..servo.image_model.gaussian_process import GaussianProcess, price, without_mistaken
from ..servo.image_model.smooth_points import SmoothPoints
from ..servo.slopes import Slopes
from .observation import BASE, OBJECT, TIP, GraspObservation

INTERMEDIATE = ("along_axis", "pixel_offset")
OFFSET_PX = 64.0
"""Of the paper's offset: about the gripper's length above the object, in the built robot."""


def target(kind: str, now: GraspObservation, share: float) -> tuple[Array, Flags]:
    """Where the tip should be (2, 2), left and right, to be a share of the way before the object.

    "along_axis": one gripper length from the object along the gripper's axis, which the paper proposes, and
    which needs to know nothing of the cameras: both ends of that length are seen. "pixel_offset": as many
    pixels above it in each image, which the paper did: y is taken for "down".

    Args:
        kind: One of `INTERMEDIATE`.
        now: What is seen.
        share: 1 at the intermediate position, 0 at the object.

    Returns:
        It, and whether (2,) all of which it follows is seen now.
    """
    points, visible = now.points, now.visible
    if kind == "along_axis":
        seen = np.asarray(visible[[TIP, BASE, OBJECT]].all(0))
        return points[OBJECT] + share * (points[BASE] - points[TIP]), seen
    return points[OBJECT] - share * OFFSET_PX * IMAGE_UNIT * np.array([0.0, 1.0]), visible[OBJECT]


NOISIER = (1.0, 2.0, 4.0)
"""So many times what a gripper that stands still tells the noise may be. Choice: a gripper that turns hides
other parts of itself in each look, and is told by the rest."""


@dataclass(frozen=True)
class Tip:
    """The tip as smooth functions of registers, one for each of `NOISIER`.

    Attributes:
        start: What is known before.
        noise_px: Standard deviation of an image coordinate, while the gripper stands still.
        functions: With what was seen.
    """

    start: GaussianProcess
    noise_px: float
    functions: tuple[GaussianProcess, ...]

    @classmethod
    def of(cls, start: GaussianProcess, looks: Iterable[GraspObservation], noise_px: float) -> Self:
        """What is known of it before, with looks."""
        tip = cls(start, noise_px, (start,) * len(NOISIER))
        for each in looks:
            tip = tip.with_look(each)
        return tip

    def with_look(self, now: GraspObservation) -> Self:
        """The same after one more look."""
        place, tip, seen = now.arm, now.at("tip"), now.visible[TIP]
        functions = (
            function.with_look(place, tip, variance, seen)
            for function, variance in zip(self.functions, self._variances, strict=True)
        )
        return replace(self, functions=tuple(functions))

    @property
    def _variances(self) -> list[float]:
        return [(noisier * self.noise_px * IMAGE_UNIT) ** 2 for noisier in NOISIER]

    @cached_property
    def explained(self) -> tuple[GaussianProcess, float]:
        """What explains best what was seen: without looks that are mistaken, and as noisy as it is.

        The function, and the variance of an image coordinate, in square image units.
        """
        start, functions = self.start, self.functions
        if len(start.looks.places) == start.known_slopes:
            functions = tuple(without_mistaken(function, start) for function in functions)
        odds = [
            float(function.evidence.max()) + price() * np.isinf(function.looks.variances).sum()
            for function in functions
        ]
        best = int(np.argmax(odds))
        return functions[best], self._variances[best]


def known_before(estimator: Any, registers: Array) -> GaussianProcess:
    """What a servo knew of the tip before a trial; or its Jacobian at registers (m,), if that is all."""
    if isinstance(estimator, SmoothPoints):
        return estimator.before[0]
    return SmoothPoints(len(registers), Slopes.of(estimator.jacobian, registers)).before[0]


UNEXPECTED = 4.0
"""So many standard deviations from where it is expected an object has been moved. Choice."""
EXPECTED_PX = 1.0
"""Where the arm met nothing, an object must be expected so surely (a deviation) to be seen to have moved.
Tuned on worlds 20000 to 20059, where nothing that lay still was seen so."""
MOVED_PX = 8.0
"""An object that is seen so far from where it should be has been moved. Choice: ten times the noise."""

Target = Callable[[GraspObservation], tuple[Array, Flags]]
"""Where something should be seen (2, 2) that hangs together with the object, and whether it is (2,)."""


class Lying:
    """Looks of an object that lies.

    Attributes:
        moved: How far it seems to have been moved (2, 2) since the trial began, in both images.

    Args:
        first: The first look.
    """

    def __init__(self, first: GraspObservation) -> None:
        self.moved: Array = np.zeros((2, 2))
        self._looks = [(first, self.moved)]

    def look(self, now: GraspObservation, variance: float, untouched: bool) -> None:
        """Takes in a look.

        Args:
            now: What is seen.
            variance: Of an image coordinate.
            untouched: Whether the arm has met nothing so far in the trial.
        """
        if now.visible[OBJECT].all():
            points = self.points(lambda each: (each.points[OBJECT], each.visible[OBJECT]), variance)
            expected = points.at(now.arm).object
            unsure_px = float(np.sqrt(expected.variances.max())) / IMAGE_UNIT
            by = now.at("object") - expected.points
            if unsure_px <= EXPECTED_PX or not untouched:
                far = lengths_px(by).max() > max(MOVED_PX, UNEXPECTED * unsure_px)
                self.moved = self.moved + by if far else self.moved
        self._looks.append((now, self.moved))

    def points(self, target_of: Target, variance: float) -> SmoothPoints:
        """A target over registers, as object points, by all looks, of the object as it lies now."""
        points = SmoothPoints(len(self._looks[0][0].arm))
        home = target_of(self._looks[0][0])[0]
        for each, moved in self._looks:
            (there, visible), points.home = target_of(each), home + moved
            place = np.concatenate([each.arm, points.home.ravel()])
            points.object = points.object.with_look(place, there - points.home, variance, visible)
        return points
