"""Rotations by three angles, about x, then y, then z as they stand turned (batched, without SciPy)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.observation import Array


def rotation(angles: Array) -> Array:
    """Rotation matrices (..., 3, 3) of angles (..., 3) in rad: the product of those about x, y and z."""
    c, s = np.cos(angles), np.sin(angles)
    cx, cy, cz, sx, sy, sz = (each[..., i] for each in (c, s) for i in range(3))
    rows = [
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    ]
    return _matrix(rows)


def rotation_axes(angles: Array) -> Array:
    """Axes (..., 3, 3) about which each of the angles (..., 3) turns, as columns, in the turned frame."""
    c, s = np.cos(angles), np.sin(angles)
    cy, cz, sy, sz = (each[..., i] for each in (c, s) for i in (1, 2))
    return _matrix([[cy * cz, sz, 0.0], [-cy * sz, cz, 0.0], [sy, 0.0, 1.0]])


def _matrix(rows: Sequence[Sequence[Array | float]]) -> Array:
    """Matrices (..., 3, 3) from their entries (...), of which the first is an array."""
    matrix = np.empty((*np.shape(rows[0][0]), 3, 3))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            matrix[..., i, j] = entry
    return matrix
