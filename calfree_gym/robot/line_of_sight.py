"""Which points the cameras see past the arm, the marks and what stands in the way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.rays import MARKS, shares_by_camera
from calfree_gym.robot.simulation import Simulation

if TYPE_CHECKING:
    from calfree_gym.world.value import World

NOWHERE = np.full(3, 1e3)
"""Where an object hides nothing (m)."""


class LinesOfSight:
    """Which points the cameras of N worlds see past the arm, the marks and what stands in the way.

    The gripper point is seen where both of its marks are.

    Args:
        simulation: The N worlds.
        radius: Of the marks (m).
    """

    LEAST_SHARE = 0.5
    """Of a ball that must be in sight. Choice: of half a ball the middle is still found."""

    def __init__(self, simulation: Simulation, radius: float) -> None:
        self._simulation, self._radius = simulation, radius
        self._picture = simulation.picture()
        model, prefix = self._picture[0], simulation.prefix
        self._balls = [model.geom(prefix + name).id for name in MARKS]
        self._cameras = [model.camera(prefix + name).id for name in CAMERAS]

    def in_sight(self, row: int) -> Flags:
        """Which points (4,) are seen now: gripper left and right, object left and right."""
        return self.shares(row) >= self.LEAST_SHARE

    def gripper_in_sight(self, row: int, motors: MotorMap, world: World) -> bool:
        """Whether nothing hides the gripper at home in a world, into which the row is put."""
        motors.set_world(row, world)
        self._simulation.set_world(row, world)
        home = motors.joints(np.zeros((1, motors.lowest.shape[1])), np.array([row]))[0]
        return bool(self.shares(row, home, NOWHERE)[:2].min() == 1)

    def shares(self, row: int, joints: Array | None = None, object_: Array | None = None) -> Array:
        """Which share (4,) of each point's marks is in sight: gripper left and right, object left and right.

        Args:
            row: The row.
            joints: Joint positions (j,), where they are to be others than now.
            object_: Where the object would be (3,).
        """
        picture = self._simulation.show(row, self._picture, joints, object_)
        balls = picture[1].geom_xpos[self._balls]
        left, right = shares_by_camera(picture, self._cameras, balls, self._radius)
        return np.array([left[:2].min(), right[:2].min(), left[2], right[2]])
