"""The smooth map from control words to the positions of the motors' joints.

A motor's register is the sum of the words sent to it since home, within its end stops. The position of its
joint follows the register through a smooth, strictly monotone curve that no controller knows:

    position = home + zero error + sign * gain * span * (t + curvature * t * (t**2 - 1))
    t = r + depth * period / (2 pi) * (sin(2 pi r / period + phase) - sin(phase))

The register is r. Where the gear ripples, t may pass +-1, beyond which that curve is straight. Where home and
zero error lie beyond a stop, home is at that stop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.robot.arms.robot import Robot

if TYPE_CHECKING:
    from calfree_gym.world import World


_BISECTIONS, _NEWTON_STEPS = 6, 4
"""Of the curve's inverse: after these, Newton's steps are exact to rounding (guards)."""
_RIPPLE_BISECTIONS = 60
"""Of its inverse where the gear ripples, which Newton's steps may leave: exact to rounding (a guard)."""


def curve_inverse(values: Array, curvature: Array) -> Array:
    """Registers in [-1, 1] at which r + curvature * r * (r**2 - 1) is `values`; beyond the ends, the end."""
    values = np.clip(values, -1.0, 1.0)
    low, high = np.full_like(values, -1.0), np.full_like(values, 1.0)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        above = middle + curvature * middle * (middle**2 - 1) > values
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    register = (low + high) / 2
    for _ in range(_NEWTON_STEPS):
        error = register + curvature * register * (register**2 - 1) - values
        register = np.clip(register - error / (1 + curvature * (3 * register**2 - 1)), -1.0, 1.0)
    return register


class MotorMap:
    """The motor maps of N worlds, one row each.

    Attributes:
        lowest, highest: Registers (N, m) at which each motor stops.

    Args:
        rows: N.
        robot: The arm.
    """

    def __init__(self, rows: int, robot: Robot) -> None:
        self._robot = robot
        motors = len(robot.motors)
        self._rest = np.zeros((rows, motors))
        self._linear = np.ones((rows, motors))
        self._cubic = np.zeros((rows, motors))
        self._curvature = np.zeros((rows, motors))
        self._rate, self._phase, self._swing = (np.zeros((rows, motors)) for _ in range(3))
        self._of_angles = np.stack([robot.rest(np.zeros(len(robot.joints)))] * rows)
        self._ripples = False
        self.lowest = np.full((rows, motors), -1.0)
        self.highest = np.full((rows, motors), 1.0)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the motors of `world`."""
        robot, motors = self._robot, len(self._robot.motors)
        scale = world.motor_sign * world.motor_gain * robot.span
        stops = robot.stops + np.stack([robot.stop_margin, -robot.stop_margin], -1)
        self._rest[row] = np.clip(robot.home + world.joint_zeros[:motors], *stops.T)
        self._curvature[row] = world.motor_curvature
        self._linear[row] = scale * (1 - world.motor_curvature)
        self._cubic[row] = scale * world.motor_curvature
        self._of_angles[row] = robot.rest(world.joint_zeros)
        period, self._phase[row], depth = world.gear_ripple.T
        self._rate[row], self._swing[row] = 2 * np.pi / period, depth * period / (2 * np.pi)
        self._ripples = bool(self._swing.any())
        ends = self._inverse((stops.T - self._rest[row]) / scale, row)
        self.lowest[row], self.highest[row] = ends.min(0), ends.max(0)

    def positions(self, registers: Array, rows: Rows) -> Array:
        """Positions of the motors' joints (n, m), in rad or m, at `registers` (n, m) of the given rows."""
        return np.asarray(self._rest[rows] + self._travel(registers, rows))

    def _travel(self, registers: Array, rows: Rows | int) -> Array:
        """How far the joints (n, m) have come from home."""
        linear, cubic = self._linear[rows], self._cubic[rows]
        if not self._ripples:
            return np.asarray(registers * (linear + cubic * (registers * registers)))
        swing, phase = self._swing[rows], self._phase[rows]
        turned = registers + swing * (np.sin(self._rate[rows] * registers + phase) - np.sin(phase))
        bent = np.where(swing > 0, np.clip(turned, -1.0, 1.0), turned)
        return np.asarray(bent * (linear + cubic * (bent * bent)) + (turned - bent) * (linear + 3 * cubic))

    def angles(self, positions: Array, rows: Rows) -> Array:
        """Positions of all joints (n, ..., j) where the motors' are at `positions` (n, ..., m)."""
        rest = self._of_angles[rows]
        return self._robot.angles(positions, rest if positions.ndim == 2 else rest[:, None])

    def joints(self, registers: Array, rows: Rows) -> Array:
        """Positions of all joints (n, j) at `registers` (n, m) of the given rows."""
        return self.angles(self.positions(registers, rows), rows)

    def registers(self, positions: Array, row: int) -> Array:
        """Registers (m,) at which the motors' joints of a row are at `positions` (m,)."""
        return self._inverse((positions - self._rest[row]) / (self._linear[row] + self._cubic[row]), row)

    def _inverse(self, values: Array, row: int) -> Array:
        """Registers (..., m) at which joints of a row have come so many spans (..., m) from home."""
        found = curve_inverse(values, self._curvature[row])
        if not self._swing[row].any():
            return found
        low, high, scale = (
            np.full_like(found, -1.0),
            np.full_like(found, 1.0),
            self._linear[row] + self._cubic[row],
        )
        for _ in range(_RIPPLE_BISECTIONS):
            middle = (low + high) / 2
            above = self._travel(middle, row) / scale > values
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.where(self._swing[row] > 0, (low + high) / 2, found)

    def reaches(self, positions: Array, register: float, rows: Rows) -> Flags:
        """Which positions (n, k, m) registers of at most this magnitude reach (n, k)."""
        travel = positions - self._rest[rows][:, None]
        ends = np.full_like(self._rest[rows], register)
        there, back = self._travel(ends, rows)[:, None], self._travel(-ends, rows)[:, None]
        furthest = np.where(travel * there > 0, there, back)  # a gear that ripples goes farther one way
        return np.all(np.abs(travel) <= np.abs(furthest), axis=-1)
