"""The stereo pair: pinhole projection, lens, image units, and what is in view."""

import numpy as np

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_UNIT

MOUNTS = ("waist", "stand")
"""Where the cameras are fixed: on the arm's first link, turning with it, or in the room."""


def pinhole(points: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Pinhole coordinates in focal lengths (..., 2), x right and y down, and depths (...) in m.

    Args:
        points: In m (..., 3), in the frame of the cameras' mount.
        position: Optical centres (..., 3).
        rotation: Camera axes as columns (..., 3, 3).
    """
    seen = ((points - position)[..., None] * rotation).sum(-2)
    depth = -seen[..., 2]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    return seen[..., :2] * [1.0, -1.0] / safe[..., None], depth


def undistort(distorted: Array, k1: float) -> tuple[Array, Flags]:
    """Pinhole points (..., 2) that a lens shows at `distorted` (..., 2), by Newton's method.

    Returns:
        Them, and whether (...) the lens shows anything there at all.
    """
    radius = np.sqrt((distorted * distorted).sum(-1))
    fold = 1 / np.sqrt(-3 * k1) if k1 < 0 else np.inf
    found = np.minimum(radius, fold)
    for _ in range(30):
        slope = np.maximum(1 + 3 * k1 * found**2, 1e-9)
        found = np.minimum(found - (found * (1 + k1 * found**2) - radius) / slope, fold)
    shown = np.abs(found * (1 + k1 * found**2) - radius) < 1e-9
    return distorted * (found / np.maximum(radius, 1e-12))[..., None], shown


def image_points(flat: Array, focal: Array, principal: Array, k1: Array) -> tuple[Array, Flags]:
    """Where a lens shows pinhole points, in image units and unclipped (..., 2), and which it shows (...).

    A lens with k1 < 0 shows nothing beyond the radius at which its image folds back.

    Args:
        flat: Pinhole points in focal lengths (..., 2).
        focal: Focal length in image units (..., 1).
        principal: Principal point in image units (..., 2).
        k1: Radial distortion (...).
    """
    squares = flat * flat
    bend = k1 * (squares[..., 0] + squares[..., 1])
    return flat * (1 + bend)[..., None] * focal + principal, bend > -1 / 3


def inside(points: Array, margin_px: float) -> Flags:
    """Which image points (..., 2) lie at least `margin_px` inside the image."""
    return np.all(np.abs(points) <= 1 - margin_px * IMAGE_UNIT, axis=-1)
