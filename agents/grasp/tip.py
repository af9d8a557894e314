"""Where the gripper's tip is seen: over registers, and as noisily as the looks of a trial tell."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from ..jacobian import Slopes
from ..servo.image_model.smooth_function import SmoothFunction
from ..servo.image_model.smooth_points import SmoothPoints
from .observation import ARM, TIP, GraspObservation

NOISIER = (1.0, 2.0, 4.0)
"""So many times what a gripper that stands still tells the noise may be. Choice: a gripper that turns hides
other parts of itself in each look, and is told by the rest."""


class Tip:
    """The tip as smooth functions of registers, one for each of `NOISIER`.

    Args:
        start: What is known before.
        looks: What was seen already.
        noise_px: Standard deviation of an image coordinate, while the gripper stands still.
    """

    def __init__(self, start: SmoothFunction, looks: Iterable[GraspObservation], noise_px: float) -> None:
        self._noise_px, self._functions = noise_px, [start] * len(NOISIER)
        for each in looks:
            self.look(each)

    def look(self, now: GraspObservation) -> None:
        """Takes in what is seen of it."""
        place, tip, seen = now.registers[:ARM], now.at("tip"), now.visible[TIP]
        self._functions = [
            function.with_look(place, tip, self._variance(noisier), seen)
            for function, noisier in zip(self._functions, NOISIER, strict=True)
        ]

    @property
    def function(self) -> SmoothFunction:
        """The one that explains best what was seen (the evidence)."""
        return self._functions[self._best]

    @property
    def variance(self) -> float:
        """Of an image coordinate, in square image units, as far as that one tells."""
        return self._variance(NOISIER[self._best])

    def _variance(self, noisier: float) -> float:
        return (noisier * self._noise_px * IMAGE_UNIT) ** 2

    @property
    def _best(self) -> int:
        evidences = [float(function.evidence.max()) for function in self._functions]
        return evidences.index(max(evidences))


def known_before(estimator: Any, registers: Array) -> SmoothFunction:
    """What a servo knew of the tip before a trial; of one that keeps no looks, the Jacobian at registers (m,)."""
    if isinstance(estimator, SmoothPoints):
        return estimator.before[0]
    return SmoothPoints(ARM, Slopes.of(estimator.jacobian, registers)).before[0]
