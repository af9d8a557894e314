"""The straight way to the object, in registers: the one way that a first look finds free."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import RANK, RANK_OF_SQUARES

from ...base.observation import Array, Observation
from ...base.procedure import Procedure
from ...jacobian import distance_jacobian
from .leash import Leash
from .linear_view import LinearView

NEITHER = 1e-4
"""A word, or a part of one, that is no motion (a guard above rounding)."""


class StraightWay:
    """Goes to the object straight in registers, look by look, until it is near or comes no nearer.

    Images show some ways of the gripper ten times less than others, such as away from the cameras. A servo
    that is cautious by how far images may curve on its whole way puts those off: it goes where images change
    most, and beside the straight way. Motions on a leash are too short for such curves to matter, so here
    only the noise of the measured Jacobian counts: a motion goes where the square of the image distance is
    then expected to be least.

    Where the arm meets something, it goes back to where it came from, and from then on nowhere in that
    direction: it slides along what it has met, as far as the direction tells how that lies.

    Words and registers are in units.

    Args:
        view: What is known of the Jacobian; others correct it.
        leash: The leash that it is on.
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

    def __init__(self, view: LinearView, leash: Leash, units: Array) -> None:
        self._view, self._leash, self._units = view, leash, units
        self._met: list[Array] = []

    def go(self, now: Observation) -> Procedure:
        """Goes from `now` on; back, where a point is lost.

        Also where it met something: to the last place on its way; if it meets something from there too, to
        the place before that.
        """
        seen_at, failures, trail = now.registers, 0, [now.registers]
        for _ in range(self.MOTIONS):
            words = seen_at - now.registers
            if now.visible.all():
                if now.distance_px < self.NEAR_PX or failures >= self.FAILURES:
                    break
                words, seen_at = self.words(now), now.registers
            if now.last or np.abs(words).max() < NEITHER:
                break
            before, jacobian = now, distance_jacobian(self._view.jacobian) * self._units
            contacts = self._leash.contacts
            now = yield words
            executed = now.registers - before.registers
            if self._leash.contacts > contacts and not now.last:
                self._met.append(words / np.linalg.norm(words))
                now = yield trail[-1] - now.registers
                trail = trail[:-1] or trail
                continue
            trail.append(now.registers)
            if before.visible.all():
                far, left = np.linalg.norm(before.distance), np.linalg.norm(now.distance)
                expected = far - np.linalg.norm(before.distance + jacobian @ executed)
                failures += not now.visible.all() or bool(far - left < self.NEARER * expected)

    def words(self, now: Observation) -> Array:
        """All of the way (m,), by words that press against no stop and in no direction that met something."""
        units, motors = self._units, len(self._units)
        jacobian = distance_jacobian(self._view.jacobian) * units
        unsure = 2 * len(now.distance) * self._view.variances * np.outer(units, units)
        square, slope = jacobian.T @ jacobian + unsure, jacobian.T @ now.distance
        stops = self._leash.stops.of(units)
        unit = np.eye(motors)
        at_stops = [*unit[now.registers >= stops.highest], *-unit[now.registers <= stops.lowest]]
        closed = np.array([*self._met, *at_stops]).reshape(-1, motors)
        pressed = np.zeros(len(closed), bool)
        while True:
            free = unit - np.linalg.pinv(closed[pressed], rcond=RANK) @ closed[pressed]
            inverse = np.linalg.pinv(free @ square @ free, hermitian=True, rcond=RANK_OF_SQUARES)
            words = -free @ inverse @ free @ slope
            presses = closed @ words > NEITHER
            if not (presses & ~pressed).any():
                return np.clip(now.registers + words, stops.lowest, stops.highest) - now.registers
            pressed |= presses
