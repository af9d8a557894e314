"""Arms without physics: they are where they were sent at once, and what is seen follows in closed form."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calfree_gym.geometry import Array, Rows, rotation_matrix
from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.simulation import ReachSimulation, write
from calfree_gym.vision.cameras import pinhole

if TYPE_CHECKING:
    from calfree_gym.world.value import World


class KinematicSimulation(ReachSimulation):
    """Arms that are placed where physics would settle.

    Gripper and image points are computed from the chain of joints, for all rows at once; MuJoCo keeps the
    state, and draws it.

    Args:
        rows, robot, mounts, threads: See `Simulation`.
    """

    of_world: ClassVar[tuple[str, ...]] = (*ReachSimulation.of_world, "_centres", "_axes")

    def __init__(self, rows: int, robot: Robot, mounts: Mounts, threads: int) -> None:
        super().__init__(rows, robot, mounts, threads)
        self._fixed_to = mounts
        self._centres, self._axes = np.zeros((3, 2, rows)).T, np.zeros((3, 3, 2, rows)).T
        self._points = np.moveaxis(np.zeros((3, 2, rows)), 0, -1)
        self._seen = np.zeros((2, rows, 2, 2)), np.zeros((2, rows, 2))

    def set_world(self, row: int, world: World) -> None:
        """See `Simulation`."""
        super().set_world(row, world)
        self._centres[row] = world.camera_position
        self._axes[row] = [rotation_matrix(each) for each in world.camera_orientation]

    def _settle(self, rows: Rows, joints: Array) -> None:
        write(self._all_qpos, rows, self._qpos, joints)

    def refresh(self) -> None:
        """See `Simulation`."""
        joints, lengths = self._all_qpos[:, self._qpos], self._lengths
        self._points[0] = self._robot.gripper_position(joints, lengths)
        self._points[1] = self._object[:, self._mocap]
        before_cameras = self._robot.into_mounts(self._points, joints, lengths, self._fixed_to)
        self._seen = pinhole(before_cameras, self._centres, self._axes)

    def pinhole_pixels(self) -> tuple[Array, Array]:
        """See `ReachSimulation`."""
        flat, depth = self._seen
        pixels = (flat * self._focal + PIXELS_PER_UNIT).swapaxes(0, 1)
        return pixels.reshape(self.rows, 4, 2), depth.swapaxes(0, 1).reshape(self.rows, 4)

    def positions(self) -> tuple[Array, Array]:
        """See `Simulation`."""
        gripper, objects = self._points
        return gripper.copy(), objects.copy()
