"""Rotations by rotation vectors, an axis times the angle about it, and how they change with these."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array

_SMALL = 1e-2
"""Below such a square of an angle, power series are more exact than quotients (a guard)."""


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return rotation_and_jacobian(vector)[0]


def rotation_and_jacobian(vector: Array) -> tuple[Array, Array]:
    """Rotation matrices R (..., 3, 3), and their left Jacobians V: with the vector, R x turns by V d(vector).

    Source: Solà, Deray & Atchuthan 2018, "A micro Lie theory", equations 134 and 145.
    """
    cross, (first, second, third) = cross_matrix(vector), _factors(vector)
    squared = cross @ cross
    unit = np.eye(3)
    return unit + first * cross + second * squared, unit + second * cross + third * squared


def jacobian_derivative(vector: Array, slide: Array) -> Array:
    """Of V u (..., 3, 3) by the rotation vectors (..., 3), for vectors u (..., 3)."""
    first, second, third = _factors(vector)
    squares = _squares(vector)
    small = squares < _SMALL
    some = np.where(small, 1.0, squares)
    second_slope = np.where(small, -1 / 12 + squares / 180 - squares**2 / 6720, (first - 2 * second) / some)
    third_slope = np.where(small, -1 / 60 + squares / 1260 - squares**2 / 60480, (second - 3 * third) / some)
    cross = cross_matrix(vector)
    once = turned(cross, slide)
    twice = turned(cross, once)
    along = (vector * slide).sum(-1)[..., None, None]
    of_twice = along * np.eye(3) + _outer(vector, slide) - 2 * _outer(slide, vector)
    growing = _outer(second_slope[..., 0] * once + third_slope[..., 0] * twice, vector)
    return np.asarray(growing - second * cross_matrix(slide) + third * of_twice)


def cross_matrix(vector: Array) -> Array:
    """The matrices (..., 3, 3) that make cross products with vectors (..., 3)."""
    matrix = np.zeros((*vector.shape, 3))
    for row, column, component in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        matrix[..., row, column] = vector[..., component]
        matrix[..., column, row] = -vector[..., component]
    return matrix


def turned(matrices: Array, vectors: Array) -> Array:
    """Products (..., 3) of matrices (..., 3, 3) and vectors (..., 3)."""
    return np.asarray(matrices @ vectors[..., None])[..., 0]


def _outer(first: Array, second: Array) -> Array:
    return first[..., :, None] * second[..., None, :]


def _squares(vector: Array) -> Array:
    return np.asarray((vector * vector).sum(-1))[..., None, None]


def _factors(vector: Array) -> tuple[Array, Array, Array]:
    """Sin a / a, (1 - cos a) / a², (a - sin a) / a³ (..., 1, 1) for angles a."""
    squares = _squares(vector)
    small = squares < _SMALL
    some = np.where(small, 1.0, squares)
    angles = np.sqrt(some)
    first, second = np.sin(angles) / angles, (1 - np.cos(angles)) / some
    if not small.any():
        return first, second, (1 - first) / some
    return (
        np.where(small, 1 - squares / 6 * (1 - squares / 20 * (1 - squares / 42)), first),
        np.where(small, (1 - squares / 12 * (1 - squares / 30 * (1 - squares / 56))) / 2, second),
        np.where(small, (1 - squares / 20 * (1 - squares / 42 * (1 - squares / 72))) / 6, (1 - first) / some),
    )
