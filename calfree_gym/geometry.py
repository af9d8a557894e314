"""Which numbers are equal but for rounding; rotations as unit quaternions (w, x, y, z) by MuJoCo.

Kernels of linear algebra differ in the last bits of numbers: nothing may be chosen by these.
"""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rows = slice | NDArray[np.intp]
"""Some of N worlds that stand side by side."""
BITS = 20
"""Of numbers that are compared. Choice: a millionth, far above rounding, and below what matters."""
RANK, RANK_OF_SQUARES = 1e-9, 1e-12
"""Singular values of a matrix below this share of the largest are none, and eigenvalues of sums of squares.
Choice: far above what rounding leaves of zeros, and below what motions and images show."""
PERPENDICULAR = 1e-5
"""Vectors whose cosine is no larger are perpendicular. Measured: rounding leaves up to 4e-6, as registers
are in single precision, and no other of 1,200 was below 1e-5 (`unified_servo`, wild worlds 7000 to 7011)."""


def rounded(values: ArrayLike) -> Any:
    """Values of any shape to six digits: among equals the first one is then the least or the largest.

    Sort them with `kind="stable"`.
    """
    mantissas, exponents = np.frexp(values)
    return np.ldexp(np.round(mantissas * 2**BITS), exponents - BITS)


def inner(first: Array, second: Array) -> float:
    """The inner product of two vectors (n,), whose sign can be trusted: 0 where they are perpendicular."""
    product = float(first @ second)
    lengths = np.sqrt((first @ first) * (second @ second))
    return product if abs(product) > PERPENDICULAR * lengths else 0.0


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
    right = np.cross([0.0, 0.0, 1.0], backward)
    right = right / np.linalg.norm(right)
    quaternion = np.empty(4)
    axes = np.stack([right, np.cross(backward, right), backward], -1)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    return quaternion
