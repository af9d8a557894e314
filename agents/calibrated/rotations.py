"""Rotations by three angles, about x, then y, then z as they stand turned (batched, without SciPy)."""

from __future__ import annotations

import numpy as np

from agents.base.observation import Array


def rotation(angles: Array) -> Array:
    """Rotation matrices (..., 3, 3) of angles (..., 3) in rad."""
    x, y, z = np.moveaxis(angles, -1, 0)
    one, none = np.ones_like(x), np.zeros_like(x)
    about_x = [one, none, none, none, np.cos(x), -np.sin(x), none, np.sin(x), np.cos(x)]
    about_y = [np.cos(y), none, np.sin(y), none, one, none, -np.sin(y), none, np.cos(y)]
    about_z = [np.cos(z), -np.sin(z), none, np.sin(z), np.cos(z), none, none, none, one]
    first, second, third = (
        np.stack(rows, -1).reshape(*x.shape, 3, 3) for rows in (about_x, about_y, about_z)
    )
    return first @ second @ third


def rotation_axes(angles: Array) -> Array:
    """Axes (..., 3, 3) about which each of the angles (..., 3) turns, as columns, in the turned frame."""
    _, y, z = np.moveaxis(angles, -1, 0)
    none = np.zeros_like(y)
    columns = [
        [np.cos(y) * np.cos(z), -np.cos(y) * np.sin(z), np.sin(y)],
        [np.sin(z), np.cos(z), none],
        [none, none, np.ones_like(y)],
    ]
    return np.stack([np.stack(column, -1) for column in columns], -1)
