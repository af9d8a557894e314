"""The stereo pair: pinhole projection and lens, of one camera and of the pairs of N worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import ONE, Array, Flags, in_frame, rotation_matrix
from calfree_gym.image import IMAGE_UNIT, PIXELS_PER_UNIT
from calfree_gym.pool import OfWorlds

if TYPE_CHECKING:
    from calfree_gym.world.value import World

MOUNTS = ("waist", "stand")
"""Where the cameras are fixed: on the arm's first link, turning with it, or in the room."""
_RIGHT_DOWN = np.array([1.0, -1.0])
"""An image's directions in a camera's axes, of which the second points up."""
_UNDISTORTING = 30
"""Steps (a guard: a dozen are enough for most lenses)."""


def pinhole(points: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Pinhole coordinates in focal lengths (..., 2), x right and y down, and depths (...) in m.

    Args:
        points: In m (..., 3), in the frame of the cameras' mount.
        position: Optical centres (..., 3).
        rotation: Camera axes as columns (..., 3, 3).
    """
    seen = in_frame(points, position, rotation)
    depth = -seen[..., 2]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    return seen[..., :2] * _RIGHT_DOWN / safe[..., None], depth


def fold(k1: Array | float, k2: Array | float) -> Array:
    """Squares (...) of the radius, in focal lengths, at which a lens's image folds back and ends.

    The first root of 1 + 3 * k1 * r**2 + 5 * k2 * r**4, the slope of the radius in the image; infinite where
    there is none.
    """
    inner = np.asarray(9 * k1 * k1 - 20 * k2)
    inverse = (np.sqrt(np.maximum(inner, 0.0)) - 3 * k1) / 2
    folds = (inner >= 0) & (inverse > 0)
    return np.where(folds, 1 / np.where(folds, inverse, 1.0), np.inf)


def undistort(distorted: Array, k1: float, k2: float) -> tuple[Array, Flags]:
    """Pinhole points (..., 2) that a lens shows at `distorted` (..., 2).

    Newton's method; where a step would leave what is known to hold the root, that is halved.

    Returns:
        Them, and whether (...) the lens shows anything there at all.
    """
    radius = np.sqrt((distorted * distorted).sum(-1))
    last = np.sqrt(fold(k1, k2))
    low, high, found = np.zeros_like(radius), np.full_like(radius, last), np.minimum(radius, last)
    for _ in range(_UNDISTORTING):
        square = found * found
        error = found * (1 + square * (k1 + square * k2)) - radius
        low, high = np.where(error <= 0, found, low), np.where(error >= 0, found, high)
        step = found - error / np.maximum(1 + square * (3 * k1 + square * (5 * k2)), 1e-9)
        found = np.where((step >= low) & (step <= high), step, (low + high) / 2)
    square = found * found
    shown = np.abs(found * (1 + square * (k1 + square * k2)) - radius) < 1e-9
    return distorted * (found / np.maximum(radius, 1e-12))[..., None], shown


def image_points(
    flat: Array, focal: Array, principal: Array, k1: Array | float, k2: Array | float, folds: Array | float
) -> tuple[Array, Flags]:
    """Where a lens shows pinhole points, in image units and unclipped (..., 2), and which it shows (...).

    Args:
        flat: Pinhole points in focal lengths (..., 2).
        focal: Focal length in image units (..., 1) or, once per coordinate, (..., 2).
        principal: Principal point in image units (..., 2).
        k1: Radial distortion (...).
        k2: Its second number (...).
        folds: See `fold` (...).
    """
    squares = flat * flat
    square = squares[..., 0] + squares[..., 1]
    bend = square * (k1 + k2 * square)
    return flat * (ONE + bend)[..., None] * focal + principal, square < folds


class StereoCameras(OfWorlds):
    """The cameras of N worlds, one row each.

    Args:
        rows: N.
        points: How many points `through_lens` gets, in each image.
        cameras: c, how many there are in each world.
    """

    of_world: ClassVar[tuple[str, ...]] = (
        *("_position", "_rotation", "_focal_px", "_focal", "_principal", "_k1", "_k2", "_folds"),
    )

    def __init__(self, rows: int, points: int = 2, cameras: int = 2) -> None:
        self._position = np.zeros((rows, cameras, 3))
        self._rotation = np.zeros((rows, cameras, 3, 3))
        shape = rows, cameras * points, 2  # that of the image points: equal shapes multiply fastest
        self._points, self._cameras = points, cameras
        self._centre_px = np.full(shape, PIXELS_PER_UNIT)
        self._focal_px = np.ones(shape)
        self._focal = np.ones(shape)
        self._principal = np.zeros(shape)
        self._k1, self._k2 = np.zeros(shape[:2]), np.zeros(shape[:2])
        self._folds = np.full(shape[:2], np.inf)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the cameras of `world`."""
        self._position[row] = world.camera_position
        self._rotation[row] = [rotation_matrix(q) for q in world.camera_orientation]
        of_points = self._points, self._cameras
        self._focal_px[row].reshape(*of_points, 2)[:] = world.focal_length[:, None]
        self._focal[row] = self._focal_px[row] * IMAGE_UNIT
        self._focal[row].reshape(*of_points, 2)[..., 1] *= world.pixel_aspect
        self._principal[row].reshape(*of_points, 2)[:] = world.principal_point * IMAGE_UNIT
        self._k1[row].reshape(of_points)[:] = world.lens_k1
        self._k2[row].reshape(of_points)[:] = world.lens_k2
        self._folds[row].reshape(of_points)[:] = fold(world.lens_k1, world.lens_k2)

    def project(self, points: Array, rows: NDArray[np.intp]) -> tuple[Array, Flags]:
        """Image points (..., k, c, 2), unclipped, of points (..., k, 1 or c, 3) in their rows' cameras.

        Args:
            points: In m, in the frame of the mount of both cameras, or of each.
            rows: The row of each point (k,), or that of all (1,).

        Returns:
            The image points; and which of them (..., k, c) the cameras show, if the image were large enough.
        """
        flat, depth = pinhole(points, self._position[rows], self._rotation[rows])
        of_each = slice(self._cameras)
        lens = (each[rows, of_each] for each in self._lens)
        images, shown = image_points(flat, *lens)
        return images, shown & (depth > 0)

    def through_lens(self, pixels: Array) -> tuple[Array, Flags]:
        """Image points (N, p, 2), unclipped, of points in images of square pixels without lens or offset.

        Args:
            pixels: Pinhole points (N, p, 2) in pixels from the image's upper left corner: of each point in
                turn, such as gripper and object, in each camera.

        Returns:
            The image points, and which of them (N, p) the lenses show.
        """
        flat = (pixels - self._centre_px) / self._focal_px
        return image_points(flat, *self._lens)

    @property
    def _lens(self) -> tuple[Array, ...]:
        return self._focal, self._principal, self._k1, self._k2, self._folds
