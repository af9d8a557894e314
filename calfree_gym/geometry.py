"""Rotations as unit quaternions (w, x, y, z), computed by MuJoCo's own functions."""

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rows = slice | NDArray[np.intp]
"""Some of N worlds that stand side by side."""
ZERO, ONE, MINUS_ONE, ONE_MORE = np.array(0.0), np.array(1.0), np.array(-1.0), np.array(1)
"""Numbers, the last one whole, as arrays: with these NumPy computes twice as fast as with Python's, where
arrays are small."""


def quaternion_product(first: Array, second: Array) -> Array:
    """Hamilton product (4,): a body turned by `first` turns by `second` about its own axes."""
    product = np.empty(4)
    mujoco.mju_mulQuat(product, first, second)
    return product


def quaternion_about(axis: Array, angle: float) -> Array:
    """Rotation (4,) by `angle` (rad) about `axis` (3,), which needs no unit length."""
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.asarray(axis, float) / np.linalg.norm(axis), angle)
    return quaternion


def quaternion_between(first: Array, second: Array, share: float) -> Array:
    """Rotation (4,) that is `share` of the way from `first` to `second`; beyond them outside [0, 1]."""
    turn, way = np.empty(3), np.empty(4)
    mujoco.mju_subQuat(turn, second, first)
    angle = float(np.linalg.norm(turn))
    if angle == 0 or share == 1:
        return second
    mujoco.mju_axisAngle2Quat(way, turn / angle, share * angle)
    return quaternion_product(first, way)


def direction_between(first: Array, second: Array, share: float) -> Array:
    """Unit vector (3,) that is `share` of the way from `first` to `second`; beyond them outside [0, 1]."""
    axis = np.cross(first, second)
    if (sine := float(np.linalg.norm(axis))) == 0:
        return second
    angle = share * np.arctan2(sine, first @ second)
    return np.asarray(np.cos(angle) * first + np.sin(angle) * np.cross(axis / sine, first))


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion; its columns are the turned axes."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def quaternion_of(axes: Array) -> Array:
    """Unit quaternion (4,) of a rotation matrix (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).reshape(9))
    return quaternion


def looking_at(position: Array, target: Array) -> Array:
    """Quaternion (4,) of an upright camera at `position` (3,) that looks at `target` (3,).

    A camera looks along its -z axis; x is right and y is up, as in MuJoCo and OpenGL.
    """
    backward = np.asarray(position, float) - target
    backward = backward / np.linalg.norm(backward)
    right = np.array([-backward[1], backward[0], 0.0])
    right = right / np.linalg.norm(right)
    upward = np.empty(3)
    mujoco.mju_cross(upward, backward, right)
    return quaternion_of(np.array([right, upward, backward]).T)


def points_of(x: Array, y: Array, z: Array) -> Array:
    """Points (..., 3) of their coordinates (...).

    Each of these lies together in memory: so NumPy's loops are over points, and not over three numbers.
    """
    points = np.empty((3, *np.broadcast(x, y, z).shape))
    points[0], points[1], points[2] = x, y, z
    return points.transpose(*range(1, points.ndim), 0)


def in_frame(points: Array, origin: Array, axes: Array) -> Array:
    """Points (..., 3) as a frame has them that has this origin (..., 3), and axes as columns (..., 3, 3)."""
    way = points - origin
    x, y, z = way[..., :1], way[..., 1:2], way[..., 2:]
    return np.asarray(x * axes[..., 0, :] + y * axes[..., 1, :] + z * axes[..., 2, :])
