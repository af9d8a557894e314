"""What people see of a base that docks: the scene, and at its side the image points of each camera."""

from __future__ import annotations

from typing import Any

import cv2
import mujoco
import numpy as np

from calfree_gym.engine.config import check_size
from calfree_gym.engine.frames import FINER, Viewer, draw_points
from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.rendering.renderer import Image, Renderer, View

GROUPS = (0,)
GREY = 70
"""Of what a camera sees apart from marks, which is not drawn."""


class DockFrame:
    """Draws one base: the scene, and at its side the points that its cameras see, with the tolerance.

    Args:
        arms: The bases.
        width: Of a frame, in pixels; at least its height, half of which is an image's.
        height: Of a frame, in pixels.
        as_agents_see: Nothing changes: there are no rendered images.

    Raises:
        ValueError: The size is not allowed.
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(self, arms: Any, width: int, height: int, as_agents_see: bool) -> None:
        check_size(width, height)
        self._arms, self._size = arms, (width - height // 2, height)
        self._picture = model, data = arms.simulation.picture()
        self._renderer = Renderer(model, data, FINER * max(self._size), for_people=True)

    def draw(self, row: int) -> Image:
        """A frame (height, width, 3) of one row."""
        arms = self._arms
        arms.simulation.show(row, self._picture)
        view = View(self._view(row), *(FINER * side for side in self._size))
        ((scene, _),) = self._renderer.draw([view], GROUPS)
        scene = np.asarray(cv2.resize(scene[::-1], self._size, interpolation=cv2.INTER_AREA), np.uint8)
        insets = [self._inset(row, camera) for camera in range(arms.config.cameras)]
        empty = np.full_like(insets[0], GREY)
        return np.hstack([scene, np.vstack([*insets, empty][:2])])

    def _inset(self, row: int, camera: int) -> Image:
        """What a camera sees (height / 2, height / 2, 3): of each mark its goal, tolerance and the dock's."""
        arms, size = self._arms, self._size[1] // 2
        inset = np.full((size, size, 3), GREY, np.uint8)
        points, visible = (
            each[row].reshape(2, -1, arms.config.cameras, *each.shape[2:]) for each in arms.delivered
        )
        for achieved, desired, seen in zip(*points[:, :, camera], visible[:, :, camera].T, strict=True):
            tolerance = float(arms.tolerance) * PIXELS_PER_UNIT
            draw_points(inset, np.stack([desired, achieved]), seen[::-1], desired, tolerance)
        return inset

    def _view(self, row: int) -> mujoco.MjvCamera:
        """From behind the base, at its side."""
        arms, view = self._arms, mujoco.MjvCamera()
        x, y, heading = arms.rolling.dock[row]
        view.lookat[:] = (x + arms.rolling.poses[row, 0]) / 2 + 0.3, (y + arms.rolling.poses[row, 1]) / 2, 0.3
        view.azimuth, view.elevation, view.distance = np.degrees(heading) + 55, -28, 3.2
        return view

    def close(self) -> None:
        """Frees the GL context."""
        self._renderer.close()


class DockViewer(Viewer):
    """A window that shows one base."""

    def _show(self, row: int) -> None:
        self._arms.simulation.show(row, self._picture)
