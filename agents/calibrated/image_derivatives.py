"""Image points of a model, and what they do when points or cameras move a little."""

from __future__ import annotations

import numpy as np

from agents.base.observation import Array
from agents.calibrated.model import CalibratedModel
from calfree_gym.vision.cameras import image_points, pinhole


def image_derivatives(model: CalibratedModel, points: Array) -> tuple[Array, Array, Array]:
    """Image points, with the interaction matrices of visual servoing (Hutchinson, Hager & Corke 1996).

    Args:
        model: One model, or several along leading axes (...).
        points: In m, in the frame of the cameras' mount (..., n, 3).

    Returns:
        Image points in both cameras (..., n, 2, 2); their derivatives by the place of the point
        (..., n, 2, 2, 3); and by what the cameras are (..., n, 2, 2, 8): their position (3), small turns
        about their own axes (3), the logarithm of their focal length, and k1.
    """
    axes, focal = model.camera_axes[..., None, :, :, :], model.focal_length[..., None, :, None]
    k1 = model.lens_k1[..., None, :]
    flat, depth = pinhole(points[..., None, :], model.camera_position[..., None, :, :], axes)
    seen, _ = image_points(flat, focal, np.zeros(2), k1)
    x, y = flat[..., 0], flat[..., 1]
    one, none = np.ones_like(x), np.zeros_like(x)
    by_place = _matrix([[one, none, x], [none, -one, y]]) / depth[..., None, None]
    by_turn = _matrix([[x * y, 1 + x * x, -y], [1 + y * y, x * y, x]])
    square = x * x + y * y
    lens = (1 + k1 * square)[..., None, None] * np.eye(2)
    lens = focal[..., None] * (lens + 2 * k1[..., None, None] * flat[..., :, None] * flat[..., None, :])
    by_place = lens @ by_place @ axes.swapaxes(-1, -2)
    by_k1 = focal * flat * square[..., None]
    by_camera = np.concatenate([-by_place, lens @ by_turn, seen[..., None], by_k1[..., None]], -1)
    return seen, by_place, by_camera


def _matrix(rows: list[list[Array]]) -> Array:
    """A matrix (..., r, c) from its entries (...)."""
    return np.stack([np.stack(row, -1) for row in rows], -2)
