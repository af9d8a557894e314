"""Berths from where a dock is seen by its printed tags: whole, large enough, and none behind an own one."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import PIXELS_PER_UNIT, inside, lengths
from calfree_gym.robot.arms.robot import Mounts
from calfree_gym.robot.docking.base import Base, before
from calfree_gym.robot.docking.berths import Berths
from calfree_gym.vision.dock_tags import CORNERS, MIDDLE, WIDER, prints

if TYPE_CHECKING:
    from calfree_gym.world.value import World

SMALLEST_PX = 13.0
"""The shortest side of a tag, in pixels of 512. Measured: of such with 12 to 16 px, 19 of 20 are found."""
BORDER_PX = 4.0
"""So far inside an image is a tag that is whole."""


class TaggedBerths(Berths):
    """The docks of N worlds, whose marks are found by printed tags.

    Args:
        rows, robot, mounts, tolerance: See `Berths`.
    """

    of_world: ClassVar[tuple[str, ...]] = (*Berths.of_world, "_positions")

    def __init__(self, rows: int, robot: Base, mounts: Mounts, tolerance: float) -> None:
        super().__init__(rows, robot, mounts, tolerance)
        self._positions = np.zeros((rows, self._cameras_of_each, 3))
        tags = prints(len(robot.marks))
        self._dock_tags = [tag for tag in tags if not tag.own]
        self._own_tags = [tag for tag in tags if tag.own]

    @property
    def in_view_means(self) -> str:
        """See `Berths`."""
        return f"{super().in_view_means}; all by tags of {SMALLEST_PX:g} pixels or more"

    def set_world(self, row: int, world: World) -> None:
        """See `Berths`."""
        super().set_world(row, world)
        self._positions[row] = world.camera_position

    def seen(self, poses: Array, rows: NDArray[np.intp]) -> Flags:
        """See `Berths`: all tags, also the own ones."""
        dock, own = self._grids(False, rows), self._grids(True, rows)
        seen_dock = self._found(before(poses, dock[:, None]), rows)
        return np.asarray(seen_dock & self._found(own[:, None], rows))

    def _grids(self, own: bool, rows: NDArray[np.intp]) -> Array:
        """Of the own tags of rows (n, 9 t, 3) in the bases' frame, or of the dock's in the dock's."""
        tags = self._own_tags if own else self._dock_tags
        return np.concatenate([self._marks[rows, tag.mark, None] + tag.grid for tag in tags], 1)

    def _found(self, grids: Array, rows: NDArray[np.intp]) -> Flags:
        """Where (n, k) all cameras show all tags whole, large enough, and not behind an own one.

        Args:
            grids: Of the tags in the bases' frame (n, k, 9 t, 3).
            rows: The rows (n,).
        """
        images, shown = self.cameras.project(grids[..., None, :], rows[:, None, None])
        whole = (shown & inside(images, BORDER_PX) & ~self._hidden(grids, rows)).all((-2, -1))
        corners = images.reshape(*whole.shape, -1, 9, *images.shape[-2:])[..., CORNERS, :, :]
        sides = lengths(corners - np.roll(corners, 1, axis=-3)) * PIXELS_PER_UNIT
        return np.asarray(whole & (sides.min((-3, -2, -1)) >= SMALLEST_PX))

    def _hidden(self, points: Array, rows: NDArray[np.intp]) -> Flags:
        """Which points (n, k, p, 3) are behind an own print for the cameras (n, k, p, c)."""
        eyes = self._positions[rows][:, None, None]
        rays = points[..., None, :] - eyes
        ahead = np.where(np.abs(rays[..., 0]) < 1e-9, 1e-9, rays[..., 0])
        hidden = np.zeros(rays.shape[:-1], bool)
        middles = self._grids(True, rows).reshape(len(rows), -1, 9, 3)[:, :, MIDDLE]
        for tag, middle in zip(self._own_tags, np.moveaxis(middles, 1, 0), strict=True):
            to_print = middle[:, None, None, None] - eyes
            share = to_print[..., 0] / ahead
            off = np.abs(share[..., None] * rays - to_print)[..., 1:].max(-1)
            hidden |= (share > 0) & (share < 1 - 1e-6) & (off <= WIDER * tag.side / 2)
        return hidden
