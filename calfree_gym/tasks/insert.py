"""Inserting: the peg's end is below the plate, in the hole, as images tell (Yoshimi & Allen 1994)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calfree_gym.tasks.goals import Floats, image_distances

DEPTH = 0.17
"""The peg is in where its end is seen so deep, in gripper lengths (0.092 m): 16 mm. Choice: four plates
deep."""
BESIDE = 0.3
"""Farther from the hole's axis, in gripper lengths (28 mm), no peg is below the plate: it may hang beside it.
Derived: the plate ends at half a length."""
DEEPEST = 1.0
"""No depth is told that is larger (a guard: where the gripper's length is hardly seen, it tells nothing)."""


def depth_told(tip: Floats, base: Floats, hole: Floats, visible: NDArray[np.bool_]) -> Floats:
    """How deep the peg's end is below the hole's centre, in gripper lengths (N,), as both images tell.

    By least squares: the way from the hole to the peg's end, along that from gripper base to peg's end. Above
    the plate it is negative. Where more than `BESIDE` of that way is left across, it is not positive.

    Args:
        tip: Image points (N, 2, 2) of the peg's end, left and right.
        base: Of the gripper's base.
        hole: Of the hole's centre.
        visible: Whether all of these are seen (N,); else `-DEEPEST` is told.
    """
    axis, way = (tip - base).reshape(-1, 4), (tip - hole).reshape(-1, 4)
    squares = np.maximum(np.square(axis).sum(-1), np.finfo(float).tiny)
    depth = np.clip((axis * way).sum(-1) / squares, -DEEPEST, DEEPEST)
    across = way - depth[:, None] * axis
    beside = np.square(across).sum(-1) > BESIDE**2 * squares
    return np.where(visible, np.where(beside, np.minimum(depth, 0.0), depth), -DEEPEST)


def hole_distances(achieved: Floats, desired: Floats) -> Floats:
    """Distances (..., 2) in image units, per camera, of the peg's end from the hole's centre.

    Args:
        achieved: The sensor vector of the peg's end, and how deep it is (..., 5).
        desired: That of the hole's centre, and how deep it is to be (..., 5).
    """
    return image_distances(achieved[..., :4], desired[..., :4])


def inserted(achieved: Floats, desired: Floats, tolerance: float | np.float32) -> NDArray[np.bool_]:
    """Whether (...) the peg's end is deep enough, within `tolerance` of the hole's centre in both images."""
    near = np.maximum.reduce(hole_distances(achieved, desired), axis=-1) <= tolerance
    return np.asarray(near & (achieved[..., 4] >= desired[..., 4]))
