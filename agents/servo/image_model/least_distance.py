"""Where gripper and object are expected to meet."""

from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from calfree_gym.image import rounded

from ...base.observation import POINTS, Array
from ..perception import Gating
from .gaussian_process import Expected
from .smooth_points import SmoothPoints

NEAREST = 1e-4
"""Weight of a word's square, in square image units (a guard: it decides among equals)."""
ITERATIONS, HALVINGS = 20, 5
"""Gauss-Newton steps on the way, and how often one is halved (guards)."""
ENOUGH = 0.99
"""It is found where a Gauss-Newton step leaves, or is expected to leave, this share of the square (a
guard)."""


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
        seen = np.maximum(now.gripper.variances, now.object.variances) < NEVER_SEEN**2
        self._counts = seen.astype(float)
        apart = now.apart
        certain = 2 * Gating.AGREE**2 * float(apart.variances @ self._counts) / POINTS
        self._too_much = max(LEFT**2 * self._left(apart), certain)

    def seek(self) -> LeastDistance:
        """From here; where that ends far off, also from other places, until an end is near.

        First from where the gripper was seen nearest to the object, then from anywhere. If none is, an end
        that may do is better than one that surely leaves too much.
        """
        found = self._from(self._here)
        for start in islice(self._starts(), STARTS):
            if not found.far:
                break
            found = min(found, self._from(start), key=lambda each: (each.hopeless, rounded(each.square)))
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
            towards, less = self._step(registers, there)
            if less < (1 - ENOUGH) * square:
                break
            for halving in range(HALVINGS):
                nearer = registers + towards / 2**halving
                nearer = np.minimum(np.maximum(nearer, self._lowest), self._highest)
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
        sure = self._left(there) > Gating.AGREE**2 * 2 * float(there.variances @ self._counts)
        unseen = not self._counts.all()
        return LeastDistance(registers, square, far or unseen, far and sure)

    def _left(self, apart: Expected) -> float:
        """The square of the distance, in the images that count."""
        return float(self._counts @ np.einsum("pc,pc->p", apart.points, apart.points))

    def _expected(self, registers: Array) -> tuple[Expected, float]:
        """How far gripper and object should be apart at registers (m,), and the square that counts."""
        apart, words = self._points.at(registers).apart, registers - self._here
        unsure = 2 * self._caution * float(self._counts @ apart.variances)
        return apart, self._left(apart) + unsure + NEAREST * float(words @ words)

    def _step(self, registers: Array, there: Expected) -> tuple[Array, float]:
        """A Gauss-Newton step (m,) of the motors that do not press against their stops.

        Returns:
            It, and by how much it is expected to make the square less.
        """
        motors = len(registers)
        jacobian = (there.slopes * self._counts[:, None, None]).reshape(4, motors)
        slope = there.points.reshape(4) @ jacobian + self._caution * (self._counts @ there.variance_slopes)
        slope += NEAREST * (registers - self._here)
        unsure = (self._counts @ there.slope_variances.reshape(2, -1)).reshape(motors, motors)
        curved = jacobian.T @ jacobian + 2 * self._caution * unsure
        curved.flat[:: motors + 1] += NEAREST
        free = np.where(slope > 0, registers > self._lowest, registers < self._highest)
        if free.all():
            step = -np.linalg.solve(curved, slope)
        else:
            step = np.zeros(motors)
            step[free] = -np.linalg.solve(curved[np.ix_(free, free)], slope[free])
        return step, float(-slope @ step)
