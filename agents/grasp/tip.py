"""Where the gripper's tip is seen: over registers, and as noisily as the looks of a trial tell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from ..jacobian import Slopes
from ..servo.image_model.mistaken import price, without_mistaken
from ..servo.image_model.smooth_function import SmoothFunction
from ..servo.image_model.smooth_points import SmoothPoints
from .observation import TIP, GraspObservation

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

    start: SmoothFunction
    noise_px: float
    functions: tuple[SmoothFunction, ...]

    @classmethod
    def of(cls, start: SmoothFunction, looks: Iterable[GraspObservation], noise_px: float) -> Self:
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
    def explained(self) -> tuple[SmoothFunction, float]:
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


def known_before(estimator: Any, registers: Array) -> SmoothFunction:
    """What a servo knew of the tip before a trial; or its Jacobian at registers (m,), if that is all."""
    if isinstance(estimator, SmoothPoints):
        return estimator.before[0]
    return SmoothPoints(len(registers), Slopes.of(estimator.jacobian, registers)).before[0]
