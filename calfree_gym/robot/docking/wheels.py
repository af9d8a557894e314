"""Wheels: what they execute of words, how far they turn, and the odometer, which tells what was executed.

A wheel turns, for an executed word w that follows words whose sum is r, by

    sign * gain * span * (w + curvature * w * (w**2 - 1) + ripple(r + w) - ripple(r))

The curve is that of an arm's motors, of words instead of registers, and the ripple is that of their gears.
There are no stops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.docking.base import Base
from calfree_gym.robot.motors import Registers

if TYPE_CHECKING:
    from calfree_gym.world.value import World

FARTHEST = 60.0
"""The odometer tells sums of words within +- this: those of a trial's motions."""


class WheelMap(OfWorlds):
    """How far the wheels of N worlds turn, one row each.

    Args:
        rows: N.
        base: The base.
    """

    of_world: ClassVar[tuple[str, ...]] = ("_linear", "_cubic", "_rate", "_phase", "_swing")

    def __init__(self, rows: int, base: Base) -> None:
        shape = rows, len(base.motors)
        self.shape, self._span = shape, base.span
        self._linear, self._cubic = np.ones(shape), np.zeros(shape)
        self._rate, self._phase, self._swing = (np.zeros(shape) for _ in range(3))
        self._ripples = False

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the wheels of `world`."""
        scale = world.motor_sign * world.motor_gain * self._span
        self._linear[row] = scale * (1 - world.motor_curvature)
        self._cubic[row] = scale * world.motor_curvature
        period, self._phase[row], depth = world.gear_ripple.T
        self._rate[row] = 2 * np.pi / period
        self._swing[row] = scale * depth * period / (2 * np.pi)
        self.note_worlds()

    def note_worlds(self) -> None:
        """See `OfWorlds`."""
        self._ripples = bool(self._swing.any())

    def turned(self, words: Array, counted: Array, rows: Rows) -> Array:
        """How far the wheels of `rows` turn (n, m) in rad, for words (n, m) behind sums of words (n, m)."""
        turned = words * (self._linear[rows] + self._cubic[rows] * (words * words))
        if not self._ripples:
            return np.asarray(turned)
        rate, phase = self._rate[rows], self._phase[rows]
        ripple = np.sin(rate * (counted + words) + phase) - np.sin(rate * counted + phase)
        return np.asarray(turned + self._swing[rows] * ripple)

    def within_stops(self, goal: Array, rows: Rows) -> Array:
        """The goal: wheels have no stops."""
        return goal

    def positions(self, registers: Array, rows: Rows) -> Array:
        """Sums of words, as they are: what wheels turn depends on each word."""
        return registers

    def angles(self, positions: Array, rows: Rows) -> Array:
        """Angles of the wheels, as they are: there are no other joints."""
        return positions


class Odometer(Registers):
    """The odometers of N bases: registers that have no end.

    Attributes:
        turned: How far each wheel was sent since the trial began (N, m), in rad.

    Args:
        motors: The wheels of the N worlds.
        bound: It tells sums within +- this.
    """

    state_names = ("joints", "turned")

    def __init__(self, motors: WheelMap, bound: float) -> None:
        super().__init__(motors, bound)  # type: ignore[arg-type]
        self._wheels = motors
        self.turned = np.zeros_like(self.joints)

    def home(self, rows: Rows) -> Array:
        """Zero for `rows`, and so are the angles (n, m) of their wheels."""
        super().home(rows)
        self.turned[rows] = 0.0
        return self.turned[rows]

    def move(self, rows: Rows, words: Array) -> Array:
        """Executes control words (n, m): angles (n, m) to which the wheels are sent."""
        counted = self.joints[rows].copy()
        super().move(rows, words)
        self.turned[rows] += self._wheels.turned(self.joints[rows] - counted, counted, rows)
        return self.turned[rows]

    def told(self, trials: NDArray[np.int64], motions: NDArray[np.int64]) -> Array:
        """See `Registers`."""
        told = super().told(trials, motions)
        return np.minimum(np.maximum(told, -self.bound), self.bound)
