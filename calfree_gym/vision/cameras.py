"""The stereo pair: pinhole projection and lens, of one camera and of the pairs of N worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags, in_frame, rotation_matrix
from calfree_gym.image import IMAGE_UNIT, PIXELS_PER_UNIT
from calfree_gym.pool import OfWorlds

if TYPE_CHECKING:
    from calfree_gym.world.value import World

MOUNTS = ("waist", "stand")
"""Where the cameras are fixed: on the arm's first link, turning with it, or in the room."""
_RIGHT_DOWN = np.array([1.0, -1.0])
"""An image's directions in a camera's axes, of which the second points up."""


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
        focal: Focal length in image units (..., 1) or, once per coordinate, (..., 2).
        principal: Principal point in image units (..., 2).
        k1: Radial distortion (...).
    """
    squares = flat * flat
    bend = k1 * (squares[..., 0] + squares[..., 1])
    return flat * (1 + bend)[..., None] * focal + principal, bend > -1 / 3


class StereoCameras(OfWorlds):
    """The cameras of N worlds, one row each.

    Args:
        rows: N.
        points: How many points `through_lens` gets, in each image.
        cameras: c, how many there are in each world.
    """

    of_world: ClassVar[tuple[str, ...]] = (
        *("_position", "_rotation", "_focal_px", "_focal", "_principal", "_k1"),
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
        self._k1 = np.zeros(shape[:2])

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the cameras of `world`."""
        self._position[row] = world.camera_position
        self._rotation[row] = [rotation_matrix(q) for q in world.camera_orientation]
        of_points = self._points, self._cameras
        self._focal_px[row].reshape(*of_points, 2)[:] = world.focal_length[:, None]
        self._focal[row] = self._focal_px[row] * IMAGE_UNIT
        self._principal[row].reshape(*of_points, 2)[:] = world.principal_point * IMAGE_UNIT
        self._k1[row].reshape(of_points)[:] = world.lens_k1

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
        lens = (each[rows, of_each] for each in (self._focal, self._principal, self._k1))
        images, shown = image_points(flat, *lens)
        return images, shown & (depth > 0)

    def through_lens(self, pixels: Array) -> tuple[Array, Flags]:
        """Image points (N, p, 2), unclipped, of points in the images of cameras without lens or offset.

        Args:
            pixels: Pinhole points (N, p, 2) in pixels from the image's upper left corner: of each point in
                turn, such as gripper and object, in each camera.

        Returns:
            The image points, and which of them (N, p) the lenses show.
        """
        flat = (pixels - self._centre_px) / self._focal_px
        return image_points(flat, self._focal, self._principal, self._k1)
