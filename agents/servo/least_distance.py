"""Where gripper and object are expected to meet."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from ..base.observation import POINTS, Array
from ..perception.gating import Gating
from .image_model.smooth_points import ExpectedPoints, SmoothPoints

NEAREST = 1e-4
"""Weight of a word's square, in square image units (a guard: it decides among equals)."""
ITERATIONS, HALVINGS = 20, 5
"""Gauss-Newton steps on the way, and how often one is halved (guards)."""
ENOUGH = 0.99
"""It is found where a Gauss-Newton step leaves this share of the square (a guard)."""


STARTS = 10
"""Gauss-Newton steps begin at so many places besides the present one (a guard)."""
NEVER_SEEN = 1.0
"""A point that is so unsure, in image units, was never seen: its image does not count. Choice: half of it."""
LEFT = 0.3
"""A place that leaves more than this share of the distance leaves too much: tuned on wild worlds 3000 and up;
from 0.15 to 0.6 it hardly matters."""


class LeastDistance(NamedTuple):
    """Where the least square of the image distance is expected.

    Attributes:
        registers: There (m,).
        square: What is expected of both images together, in square image units, with what is unsure of it.
        far: Whether too much of the distance is left there.
        hopeless: Whether that is sure.
    """

    registers: Array
    square: float
    far: bool
    hopeless: bool

    @property
    def length(self) -> float:
        """The distance in an image, root mean square, in image units."""
        return float(np.sqrt(self.square / 2))


class Seeker:
    """Seeks it by Gauss-Newton steps, between the motors' stops; among equals the nearest.

    An image in which gripper or object was never seen does not count; the distance is then called far.

    Args:
        points: What is known of the points.
        here: Registers (m,) to go from.
        lowest, highest: Registers (m,) at which motors are known to stop.
        caution: How much the variance of the image distance counts, beside the square of its mean.
    """

    def __init__(
        self, points: SmoothPoints, here: Array, lowest: Array, highest: Array, caution: float
    ) -> None:
        self._points = points
        self._here = here
        self._lowest, self._highest = lowest, highest
        self._caution = caution
        now = points.at(here)
        self._points_count = np.tile((now.variances < NEVER_SEEN**2).reshape(2, 2).all(0), 2)
        self._counts = self._points_count.reshape(2, 2)[0].repeat(2)
        distance = now.distance * self._counts
        certain = 2 * Gating.AGREE**2 * float(now.variances @ self._points_count) / POINTS
        self._too_much = max(LEFT**2 * float(distance @ distance), certain)

    def seek(self) -> LeastDistance:
        """From here; where that ends far off, also from where the gripper was seen nearest to the object.

        As long as it is sure that too much is left, also from other such places, and from anywhere.
        """
        found = self._from(self._here)
        for start in islice(self._starts(), STARTS):
            if not found.far:
                break
            found = min(found, self._from(start), key=lambda each: (each.hopeless, each.square))
            if not found.hopeless:
                break
        return found

    def _starts(self) -> Iterator[Array]:
        """Registers (m,) to begin at."""
        yield from self._points.places_near(self._here)
        random = np.random.default_rng(len(self._points.gripper.looks.places))
        while True:
            yield random.uniform(self._lowest, self._highest)

    def _from(self, registers: Array) -> LeastDistance:
        there, square = self._expected(registers)
        for _ in range(ITERATIONS):
            towards = self._step(registers, there)
            for halving in range(HALVINGS):
                nearer = np.clip(registers + towards / 2**halving, self._lowest, self._highest)
                expected, less = self._expected(nearer)
                if less < square:
                    break
            else:
                break
            enough = less > ENOUGH * square
            registers, there, square = nearer, expected, less
            if enough:
                break
        far = square > self._too_much
        distance = there.distance * self._counts
        sure = distance @ distance > Gating.AGREE**2 * 2 * there.variances @ self._points_count
        unseen = not self._counts.all()
        return LeastDistance(registers, square, bool(far or unseen), bool(far and sure))

    def _expected(self, registers: Array) -> tuple[ExpectedPoints, float]:
        """What should be seen at registers (m,), and the square that counts."""
        expected, words = self._points.at(registers), registers - self._here
        distance = expected.distance * self._counts
        unsure = self._caution * 2 * expected.variances @ self._points_count
        return expected, float(distance @ distance + unsure + NEAREST * words @ words)

    def _step(self, registers: Array, there: ExpectedPoints) -> Array:
        """A Gauss-Newton step (m,) of the motors that do not press against their stops."""
        jacobian = there.distance_jacobian * self._counts[:, None]
        slope = jacobian.T @ there.distance + self._caution * self._points_count @ there.variance_slopes
        slope += NEAREST * (registers - self._here)
        unsure = np.tensordot(self._points_count, there.slope_variances, 1)
        curved = jacobian.T @ jacobian + 2 * self._caution * unsure
        curved.flat[:: len(registers) + 1] += NEAREST
        free = np.where(slope > 0, registers > self._lowest, registers < self._highest)
        step = np.zeros_like(registers)
        step[free] = -np.linalg.solve(curved[np.ix_(free, free)], slope[free])
        return step
