"""Whether a camera sees a ball, or something stands before it: by rays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS

if TYPE_CHECKING:
    from calfree_gym.robot.motors import MotorMap
    from calfree_gym.robot.simulation import Picture, Simulation
    from calfree_gym.world import World

MARKS = ("gripper_mark_1", "gripper_mark_2", "object_mark")
"""Names of the balls by which gripper and object are seen."""

MARKS_GROUP, RIG_GROUP = 4, 5
"""Groups of geoms: the marks; and the cameras' own rods and housings, which their images leave out."""
SEEN = (0, 1, 2, MARKS_GROUP)
"""Groups that cameras see. By custom those of group 3 are for collisions."""
_SEEN_GROUPS = np.isin(range(mujoco.mjNGROUP), SEEN).astype(np.uint8)
NOWHERE = np.full(3, 1e3)
"""Where an object hides nothing (m)."""
_ANGLES = np.pi / 3 * np.arange(6)
_DISC = np.concatenate([np.zeros((1, 2)), 2 / 3 * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)])
"""Points (7, 2) of a disc of radius 1, each for a seventh of it."""
_GRAZING = 1.05
"""A ray that ends so many radii before a ball's centre has met the ball itself."""


def shares_in_sight(
    model: mujoco.MjModel, data: mujoco.MjData, camera: Array, balls: Array, radius: float
) -> Array:
    """Which share (k,) of each ball, as a disc, nothing hides from a camera: in sevenths.

    Args:
        model: Of the scene.
        data: Its state; geoms and all else are where they are.
        camera: Optical centre (3,).
        balls: Their centres (k, 3); whether the model has geoms there does not matter.
        radius: Of the balls (m).
    """
    sights = balls - camera
    far = np.linalg.norm(sights, axis=1, keepdims=True)
    across = np.cross(sights, np.eye(3)[np.abs(sights).argmin(1)])
    across *= radius / np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(sights / far, across)
    rays = (sights[:, None] + _DISC[:, :1] * across[:, None] + _DISC[:, 1:] * up[:, None]).reshape(-1, 3)
    lengths, geoms = np.empty(len(rays)), np.empty(len(rays), np.int32)
    mujoco.mj_multiRay(
        model,
        data,
        camera,
        rays.ravel(),
        _SEEN_GROUPS,
        1,
        -1,
        geoms,
        lengths,
        None,
        len(rays),
        mujoco.mjMAXVAL,
    )
    whole = np.linalg.norm(rays, axis=1)
    free = (lengths < 0) | (lengths * whole > whole - _GRAZING * radius)
    return np.asarray(free.reshape(len(balls), -1).mean(1))


def shares_by_camera(picture: Picture, cameras: Sequence[int], balls: Array, radius: float) -> Array:
    """As `shares_in_sight`, which share (c, k) of balls each of these cameras sees."""
    model, data = picture
    return np.stack(
        [shares_in_sight(model, data, data.cam_xpos[camera], balls, radius) for camera in cameras]
    )


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
