"""The unknown smooth map from control words to joint angles.

A motor's register is the sum of the words sent to it since home, within its end stops. A joint's angle
follows its register through a smooth, strictly monotone curve that no controller knows:

    angle = home + zero error + sign * gain * SPAN * (r + curvature * r * (r**2 - 1))

The wrist (J4) is no motor of the controller: the arm itself holds the gripper vertical, as in the paper's
section 2.1, from its own joint angles, and so tilts it where its joint zeros are wrong.
"""

import numpy as np

from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.world import World

MOTORS = ("waist", "shoulder", "elbow")
HOME = np.radians([0.0, 40.0, -80.0])
"""Joint angles (rad) of J1-J3 at registers zero, as the arm's own controller assumes them."""
SPAN = np.array([2.6, 2.0, 2.0])
"""Radians from home to register 1, at gain 1."""
JOINT_LIMITS = np.radians([[-150, 150], [-30, 100], [-120, 0], [-110, 110]])
"""Mechanical stops of J1-J4 (4, 2), as in assets/arm.xml."""
_WRIST_LOWEST, _WRIST_HIGHEST = JOINT_LIMITS[3].tolist()
STOP_MARGIN = 0.01
"""A motor stops this far (rad) before the joint's mechanical stop."""


def curve_inverse(values: Array, curvature: Array) -> Array:
    """Registers in [-1, 1] at which r + curvature * r * (r**2 - 1) is `values`; beyond the ends, the end."""
    low, high = np.full_like(values, -1.0), np.full_like(values, 1.0)
    for _ in range(60):
        middle = (low + high) / 2
        above = middle + curvature * middle * (middle**2 - 1) > values
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return (low + high) / 2


class MotorMap:
    """The motor maps of N worlds, one row each.

    Attributes:
        lowest, highest: Registers (N, 3) at which each motor stops.
    """

    def __init__(self, rows: int) -> None:
        self._rest = np.zeros((rows, 3))
        self._linear = np.ones((rows, 3))
        self._cubic = np.zeros((rows, 3))
        self._wrist_rest = np.zeros(rows)
        self.lowest = np.full((rows, 3), -1.0)
        self.highest = np.full((rows, 3), 1.0)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the motors of `world`."""
        scale = world.motor_sign * world.motor_gain * SPAN
        self._rest[row] = HOME + world.joint_zeros[:3]
        self._linear[row] = scale * (1 - world.motor_curvature)
        self._cubic[row] = scale * world.motor_curvature
        self._wrist_rest[row] = -np.pi / 2 + world.joint_zeros[1:4].sum()
        stops = JOINT_LIMITS[:3] + np.array([STOP_MARGIN, -STOP_MARGIN])
        reach = (stops - self._rest[row][:, None]) / scale[:, None]
        ends = curve_inverse(reach, world.motor_curvature[:, None])
        self.lowest[row], self.highest[row] = ends.min(-1), ends.max(-1)

    def joints(self, registers: Array, rows: Rows) -> Array:
        """Angles (n, 5) of J1-J5 in rad at `registers` (n, 3) of the given rows."""
        angles = np.zeros((len(registers), 5))
        slope = self._linear[rows] + self._cubic[rows] * (registers * registers)
        angles[:, :3] = self._rest[rows] + registers * slope
        angles[:, 3] = self.wrist(angles[:, 1], angles[:, 2], rows)
        return angles

    def wrist(self, shoulder: Array, elbow: Array, rows: Rows) -> Array:
        """Angles of J4 in rad that the arm takes for vertical, at J2 and J3 of the given rows."""
        wrist = self._wrist_rest[rows] - shoulder - elbow
        return np.minimum(np.maximum(wrist, _WRIST_LOWEST), _WRIST_HIGHEST)

    def reaches(self, joints: Array, register: float, rows: Rows) -> Flags:
        """Which angles (n, k, 3) of J1-J3 registers of at most this magnitude reach (n, k)."""
        travel = np.abs(joints - self._rest[rows][:, None])
        furthest = np.abs(register * (self._linear[rows] + self._cubic[rows] * register**2))
        return np.all(travel <= furthest[:, None], axis=-1)
