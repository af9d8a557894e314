"""The straight way to the object, in registers: the one way that a first look finds free."""

from __future__ import annotations

import numpy as np

from ...base.observation import Array, Observation
from ...base.procedure import Procedure
from ...jacobian import distance_jacobian
from ..trial import Stops
from .linear_view import LinearView


class StraightWay:
    """Goes to the object straight in registers, look by look, until it is near or comes no nearer.

    Images show some ways of the gripper ten times less than others, such as away from the cameras. A servo
    that is cautious by how far images may curve on its whole way puts those off: it goes where images change
    most, and beside the straight way. Motions on a leash are too short for such curves to matter, so here
    only the noise of the measured Jacobian counts: a motion goes where the square of the image distance is
    then expected to be least.

    Words and registers are in units.

    Args:
        view: What is known of the Jacobian; others correct it.
        stops: Where motors are known to stop, in registers; others learn it.
        units: Words of 1, of each motor (m,), see `Leash`.
    """

    NEAR_PX = 8.0
    """Nearer than this the servo goes on. Choice: twice the usual tolerance of a rendezvous."""
    NEARER = 0.2
    """A motion came nearer that brought this share of what was expected of it. Choice."""
    FAILURES = 2
    """So many motions may lose a point, or come no nearer, before the servo goes on. Choice."""
    MOTIONS = 20
    """At most (a guard)."""

    def __init__(self, view: LinearView, stops: Stops, units: Array) -> None:
        self._view, self._stops, self._units = view, stops, units

    def go(self, now: Observation) -> Procedure:
        """Goes from `now` on; back, where a point is lost."""
        seen_at, failures = now.registers, 0
        for _ in range(self.MOTIONS):
            words = seen_at - now.registers
            if now.visible.all():
                if now.distance_px < self.NEAR_PX or failures >= self.FAILURES:
                    break
                words, seen_at = self.words(now), now.registers
            if now.last or np.abs(words).max() < Stops.STOPPED:
                break
            before, jacobian = now, distance_jacobian(self._view.jacobian) * self._units
            now = yield words
            executed = now.registers - before.registers
            if before.visible.all():
                far, left = np.linalg.norm(before.distance), np.linalg.norm(now.distance)
                expected = far - np.linalg.norm(before.distance + jacobian @ executed)
                failures += not now.visible.all() or bool(far - left < self.NEARER * expected)

    def words(self, now: Observation) -> Array:
        """All of the way (m,), of motors that do not press against their stops."""
        units = self._units
        jacobian = distance_jacobian(self._view.jacobian) * units
        unsure = 2 * len(now.distance) * self._view.variances * np.outer(units, units)
        free = np.ones(len(units), bool)
        lowest, highest = self._stops.lowest / units, self._stops.highest / units
        while True:
            columns = jacobian * free
            square = columns.T @ columns + unsure * np.outer(free, free)
            words = -np.linalg.pinv(square, hermitian=True) @ columns.T @ now.distance
            presses = np.where(words > 0, now.registers >= highest, now.registers <= lowest)
            if not (pressing := free & presses & (words != 0)).any():
                return np.clip(now.registers + words, lowest, highest) - now.registers
            free &= ~pressing
