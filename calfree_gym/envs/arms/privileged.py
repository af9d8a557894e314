"""True quantities that a controller may get beside its observation, where it asks for them by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.stereo_arms import StereoArms
from calfree_gym.robot.arms.robot import Robot


class Privileged(NamedTuple):
    """A true quantity that a controller may get beside its image points, where it asks with `tell`.

    Attributes:
        size: How many numbers, for an arm.
        bound: Of their magnitude, for an arm whose registers have this bound.
        of: Gives them for all rows (N, size).
    """

    size: Callable[[Robot], int]
    bound: Callable[[Robot, float], float]
    of: Callable[[StereoArms], NDArray[np.float64]]


def joint_zeros(arms: StereoArms) -> NDArray[np.float64]:
    """Of all rows (N, k); zeros where a row was never in a world."""
    zeros = np.zeros((arms.rows, len(arms.robot.joints)))
    for row in range(arms.rows):
        if not arms.needs_seed(row):
            zeros[row] = arms.world(row).joint_zeros
    return np.clip(zeros, -np.pi, np.pi)


PRIVILEGED = {
    "joint_angles": Privileged(
        lambda robot: len(robot.built_home),
        lambda robot, _: max(2 * np.pi, 1.1 * float(np.abs(robot.stops).max())),  # repeatability passes stops
        lambda arms: arms.simulation.joints(),
    ),
    "joint_zeros": Privileged(
        lambda robot: len(robot.joints),
        lambda robot, _: np.pi,
        joint_zeros,
    ),
    "gripper_position": Privileged(
        lambda robot: 3,
        lambda robot, _: max(5.0, float(np.abs(robot.rig.target).max()) + 4 * robot.rig.scale),
        lambda arms: arms.simulation.positions()[0],
    ),
    "object_registers": Privileged(
        lambda robot: len(robot.motors), lambda robot, bound: bound, lambda arms: arms.object_registers()
    ),
}
"""True joint positions (rad or m; of the RV-M2 J1-J5), joint zeros (of the RV-M2 J1-J4), the gripper point in
the room (m), and the registers that bring the gripper to the object."""
