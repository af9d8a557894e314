"""What is seen of an object that lies, and how far it was pushed meanwhile."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.observation import Array, Flags
from ..servo.image_model.smooth_points import SmoothPoints
from .observation import OBJECT, GraspObservation

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
