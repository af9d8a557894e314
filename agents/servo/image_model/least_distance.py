"""Where gripper and object are expected to meet."""

from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from calfree_gym.image import rounded

from ...base.observation import POINTS, Array, Flags
from ..perception import Gating
from .gaussian_process import Expected
from .smooth_points import SmoothPoints

NEAREST = 1e-4
"""Weight of a word's square, in square image units (a guard: it decides among equals)."""
PLACES, SHORTEST = 12, 1 / 32
"""Places that are tried on the way, half as many on each way from elsewhere, and the share of a Gauss-Newton
step that is too short (guards)."""
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
        self._unit = np.eye(len(here))
        now = points.at(here[None])
        seen = np.maximum(now.gripper.variances, now.object.variances)[0] < NEVER_SEEN**2
        self._counts = seen.astype(float)
        apart = now.apart
        certain = 2 * Gating.AGREE**2 * apart.variances @ self._counts / POINTS
        self._too_much = float(np.maximum(LEFT**2 * self._left(apart), certain)[0])

    def seek(self) -> LeastDistance:
        """From here; where that ends far off, also from other places: the first end that is near.

        First from where the gripper was seen nearest to the object, then from anywhere. If none is, an end
        that may do is better than one that surely leaves too much.
        """
        (found,) = self._ends(self._here[None], PLACES)
        if not found.far:
            return found
        starts = np.array(list(islice(self._starts(), STARTS)))
        ends = [found, *self._ends(starts, PLACES // 2)]
        near = (each for each in ends if not each.far)
        return next(near, min(ends, key=lambda each: (each.hopeless, rounded(each.square))))

    def _starts(self) -> Iterator[Array]:
        """Registers (m,) to begin at."""
        yield from self._points.places_near(self._here)
        random = np.random.default_rng(len(self._points.gripper.looks.places))
        while True:
            yield random.uniform(self._lowest, self._highest)

    def _ends(self, registers: Array, places: int) -> list[LeastDistance]:
        """Where Gauss-Newton steps end that begin at registers (k, m), all at the same time.

        Each tries so many places at most. A step that does not help is halved.
        """
        ends = registers.copy(), *self._there(registers)
        shares = np.ones(len(registers))
        going = np.ones(len(registers), bool)
        for _ in range(places):
            here, squares, _, steps, gains = ends
            going &= gains > (1 - ENOUGH) * squares
            rows = np.flatnonzero(going)
            if not len(rows):
                break
            nearer = here[rows] + shares[rows, None] * steps[rows]
            nearer = np.minimum(np.maximum(nearer, self._lowest), self._highest)
            there = nearer, *self._there(nearer)
            better = there[1] < squares[rows]
            shares[rows] = np.where(better, np.minimum(2 * shares[rows], 1.0), shares[rows] / 2)
            going[rows] = np.where(better, there[1] <= ENOUGH * squares[rows], shares[rows] > SHORTEST)
            moved = rows[better]
            for kept, new in zip(ends, there, strict=True):
                kept[moved] = new[better]
        registers, squares, sure, *_ = ends
        far, seen = squares > self._too_much, bool(self._counts.all())
        found = zip(registers, squares.tolist(), far.tolist(), (far & sure).tolist(), strict=True)
        return [
            LeastDistance(place, square, far or not seen, hopeless) for place, square, far, hopeless in found
        ]

    def _left(self, apart: Expected) -> Array:
        """The square of the distance (...), in the images that count."""
        return np.einsum("...pc,...pc->...p", apart.points, apart.points) @ self._counts

    def _there(self, registers: Array) -> tuple[Array, Flags, Array, Array]:
        """What is expected at registers (k, m), and where to go from there.

        Returns:
            The squares that count (k,), and whether something is surely left of them (k,); Gauss-Newton steps
            (k, m) of the motors that do not press against their stops, and by how much these are expected to
            make the squares less (k,).
        """
        count, motors = registers.shape
        apart = self._points.at(registers).apart
        unsure = 2 * self._counts @ apart.covariances.reshape(count, 2, -1)
        errors = np.empty((count, 4 + motors, 1 + motors))  # each beside its slopes
        errors[:, :4] = (apart.values * self._counts[:, None, None]).reshape(count, 4, -1)
        errors[:, 4:, 0] = NEAREST**0.5 * (registers - self._here)
        errors[:, 4:, 1:] = NEAREST**0.5 * self._unit
        sums = errors.swapaxes(1, 2) @ errors + self._caution * unsure.reshape(count, 1 + motors, -1)
        squares, slopes, curved = sums[:, 0, 0], sums[:, 0, 1:], sums[:, 1:, 1:]
        free = np.where(slopes > 0, registers > self._lowest, registers < self._highest)
        slopes = slopes * free
        curved = np.where(free[:, :, None] & free[:, None], curved, self._unit)
        steps = -np.linalg.solve(curved, slopes[..., None])[..., 0]
        surely = self._left(apart) > Gating.AGREE**2 * unsure[:, 0]
        return squares, surely, steps, -np.einsum("km,km->k", slopes, steps)
