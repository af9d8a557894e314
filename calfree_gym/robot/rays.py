"""Which share of a ball a camera sees, by rays, and the groups of geoms that cameras see."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from calfree_gym.geometry import Array

MARKS = ("gripper_mark_1", "gripper_mark_2", "object_mark")
"""Names of the balls by which gripper and object are seen."""
MARKS_GROUP, RIG_GROUP = 4, 5
"""Groups of geoms: the marks; and the cameras' own rods and housings, which their images leave out."""
SEEN = (0, 1, 2, MARKS_GROUP)
"""Groups that cameras see. By custom those of group 3 are for collisions."""
_SEEN_GROUPS = np.isin(range(mujoco.mjNGROUP), SEEN).astype(np.uint8)
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


def shares_by_camera(
    picture: tuple[mujoco.MjModel, mujoco.MjData], cameras: Sequence[int], balls: Array, radius: float
) -> Array:
    """As `shares_in_sight`, which share (c, k) of balls each of these cameras sees."""
    model, data = picture
    return np.stack(
        [shares_in_sight(model, data, data.cam_xpos[camera], balls, radius) for camera in cameras]
    )
