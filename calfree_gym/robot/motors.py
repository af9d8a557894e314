"""The smooth map from control words to the positions of the motors' joints.

A motor's register is the sum of the words sent to it since home, within its end stops. The position of its
joint follows the register through a smooth, strictly monotone curve that no controller knows:

    position = home + zero error + sign * gain * span * (r + curvature * r * (r**2 - 1))

Where home and zero error lie beyond a stop, home is at that stop.
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
        self._of_angles = np.stack([robot.rest(np.zeros(len(robot.joints)))] * rows)
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
        reach = (stops - self._rest[row][:, None]) / scale[:, None]
        ends = curve_inverse(reach, world.motor_curvature[:, None])
        self.lowest[row], self.highest[row] = ends.min(-1), ends.max(-1)

    def positions(self, registers: Array, rows: Rows) -> Array:
        """Positions of the motors' joints (n, m), in rad or m, at `registers` (n, m) of the given rows."""
        slope = self._linear[rows] + self._cubic[rows] * (registers * registers)
        return np.asarray(self._rest[rows] + registers * slope)

    def angles(self, positions: Array, rows: Rows) -> Array:
        """Positions of all joints (n, ..., j) where the motors' are at `positions` (n, ..., m)."""
        rest = self._of_angles[rows]
        return self._robot.angles(positions, rest if positions.ndim == 2 else rest[:, None])

    def joints(self, registers: Array, rows: Rows) -> Array:
        """Positions of all joints (n, j) at `registers` (n, m) of the given rows."""
        return self.angles(self.positions(registers, rows), rows)

    def registers(self, positions: Array, row: int) -> Array:
        """Registers (m,) at which the motors' joints of a row are at `positions` (m,)."""
        values = (positions - self._rest[row]) / (self._linear[row] + self._cubic[row])
        return curve_inverse(values, self._curvature[row])

    def reaches(self, positions: Array, register: float, rows: Rows) -> Flags:
        """Which positions (n, k, m) registers of at most this magnitude reach (n, k)."""
        travel = np.abs(positions - self._rest[rows][:, None])
        furthest = np.abs(register * (self._linear[rows] + self._cubic[rows] * register**2))
        return np.all(travel <= furthest[:, None], axis=-1)
