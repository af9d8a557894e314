"""Where a chain brings the gripper to the object: inverse kinematics in the images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.observation import POINTS, Array, Observation, camera_lengths_px
from ..base.stops import Stops
from .chain import Views
from .known import Known

NEAREST = 1e-5
"""Weight of a register's square, in square image units (a guard: it decides among equals)."""
SEEN, DRAWN, STEPS = 3, 10, 40
"""It seeks from so many places where the gripper was seen, and drawn ones, by so many steps each (guards)."""
NOISES = 4.0
"""What is seen otherwise than expected counts as noise up to so many times that. Choice."""
LONGEST = 0.2
"""Of such a step, in registers: so it finds what is near. Choice."""
NEAR_PX, SURE_PX = 1.0, 4.0
"""It ends at a place that leaves no more than this by what is known, and is so sure. Choice: noise, and a
rendezvous."""
ENOUGH = 0.99
"""And where a step leaves more than this share of the square (a guard)."""
_DAMPING, _LESS, _MORE, _LEAST, _MOST = 1e-3, 0.2, 5.0, 1e-7, 1e3
"""Damping at first, its factors after a step that helps and one that does not, and its ends (guards)."""


class Meeting(NamedTuple):
    """A place where gripper and object are expected to meet.

    Attributes:
        registers: There (m,).
        left_px: How far from each other they are then, root mean square of both images, in pixels.
        deviation_px: Standard deviation of that, what is not known included.
    """

    registers: Array
    left_px: float
    deviation_px: float


class Seeker:
    """Seeks it by Levenberg-Marquardt between the stops, from several places.

    Args:
        known: What is known of the robot.
        home: The object's sensor vector at home (4,).
        now: What is observed now: it tells by how much what is known is wrong.
        noise_px: Standard deviation of an image coordinate.
        stops: Where motors are known to stop.
    """

    def __init__(self, known: Known, home: Array, now: Observation, noise_px: float, stops: Stops) -> None:
        self._known, self._home, self._now, self._stops = known, home, now.registers, stops
        self._offset = np.zeros(POINTS)
        if now.registers.any():
            offset = now.distance - self._distance(self._views(now.registers))
            if camera_lengths_px(offset).max() > NOISES * noise_px:
                self._offset = offset

    def seek(self) -> Meeting:
        """From here, from where the gripper was seen near, from drawn places, until an end is near."""
        random, best = np.random.default_rng(0), None
        lowest, highest = self._stops.lowest, self._stops.highest
        seen = self._known.seen
        near = np.square(seen.sensors - self._home).sum(1)
        near = rounded(near).argsort(kind="stable")[:SEEN]
        drawn = random.uniform(lowest, highest, (DRAWN, len(lowest)))
        for start in np.concatenate([self._now[None], seen.registers[near], drawn]):
            found = self._from(np.clip(start, lowest, highest))
            if best is None or rounded(found.deviation_px) < rounded(best.deviation_px):
                best = found
            if best.left_px < NEAR_PX and best.deviation_px < SURE_PX:
                break
        assert best is not None
        return best

    def _views(self, registers: Array) -> Views:
        return self._known.views_at(registers, self._home)

    def _distance(self, views: Views) -> Array:
        return np.asarray(views.points[0, :2] - views.points[0, 2:]).reshape(POINTS) + self._offset

    def _from(self, registers: Array) -> Meeting:
        lowest, highest, motors = self._stops.lowest, self._stops.highest, len(registers)
        views = self._views(registers)
        apart = self._distance(views)
        cost = float(apart @ apart + NEAREST * registers @ registers)
        damping, unit = _DAMPING, np.eye(motors)
        for _ in range(STEPS):
            by_registers = views.by_registers()[0]
            jacobian = (by_registers[:2] - by_registers[2:]).reshape(POINTS, -1)
            slope = jacobian.T @ apart + NEAREST * registers
            free = np.where(slope > 0, registers > lowest, registers < highest)
            curved = jacobian.T @ jacobian + NEAREST * unit
            gained = 0.0
            while gained <= 0 and damping < _MOST:
                step = np.zeros(motors)
                try:
                    step[free] = -np.linalg.solve((curved + damping * unit)[np.ix_(free, free)], slope[free])
                except np.linalg.LinAlgError:  # images so large that the damping is lost in rounding
                    damping *= _MORE
                    continue
                step *= min(1.0, LONGEST / max(float(np.abs(step).max()), LONGEST))
                there = np.clip(registers + step, lowest, highest)
                further = self._views(there)
                apart_there = self._distance(further)
                gained = cost - float(apart_there @ apart_there + NEAREST * there @ there)
                damping = damping * _MORE if gained <= 0 else max(damping * _LESS, _LEAST)
            if gained <= 0:
                break
            registers, views, apart, cost = there, further, apart_there, cost - gained
            if cost > ENOUGH * (cost + gained):
                break
        by_numbers = views.by_numbers()[0]
        by = (by_numbers[:2] - by_numbers[2:]).reshape(POINTS, -1)
        unsure = np.einsum("cx,xy,cy->", by, self._known.covariance, by)
        left, deviation = (
            float(np.sqrt(square / 2)) / IMAGE_UNIT for square in (apart @ apart, apart @ apart + unsure)
        )
        return Meeting(registers, left, deviation)
