"""Rotations by three angles, about x, then y, then z as they stand turned (batched, without SciPy)."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array


def rotation(angles: Array) -> Array:
    """Rotation matrices (..., 3, 3) of angles (..., 3) in rad: the product of those about x, y and z."""
    (cx, cy, cz), (sx, sy, sz) = (np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin))
    rows = [
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    ]
    return _matrix(rows)


def rotation_axes(angles: Array) -> Array:
    """Axes (..., 3, 3) about which each of the angles (..., 3) turns, as columns, in the turned frame."""
    (_, cy, cz), (_, sy, sz) = (np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin))
    none = np.zeros_like(cy)
    return _matrix([[cy * cz, sz, none], [-cy * sz, cz, none], [sy, none, none + 1]])


def _matrix(rows: list[list[Array]]) -> Array:
    """Matrices (..., 3, 3) from their entries (...)."""
    entries = np.stack([entry for row in rows for entry in row], -1)
    return entries.reshape(*entries.shape[:-1], 3, 3)
