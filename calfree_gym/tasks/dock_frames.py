"""What people see of a base that docks: the scene, and what its cameras see."""

from __future__ import annotations

import mujoco

from calfree_gym.engine.arms import Arms
from calfree_gym.engine.frames import FINER, RobotFrame, Viewer, draw_points, reduced
from calfree_gym.geometry import Array, Flags
from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.rendering.renderer import Image, Renderer
from calfree_gym.rendering.stereo_images import LensMap
from calfree_gym.robot.rays import RIG_GROUP
from calfree_gym.world import World

GROUPS = (0, RIG_GROUP)


class DockFrame(RobotFrame):
    """Draws one base, and what its cameras see.

    Args:
        arms, width, height: See `RobotFrame`.
        as_agents_see: Nothing changes: these images are lit for people, and show no tags.

    Raises:
        ValueError: The size is not allowed.
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(self, arms: Arms, width: int, height: int, as_agents_see: bool) -> None:
        super().__init__(arms, width, height)
        self._picture = arms.simulation.picture()
        self._renderer = Renderer(*self._picture, FINER * max(self._size), for_people=True)

    def views(self, row: int, configuration: Array | None = None) -> list[Image]:
        """See `RobotFrame`."""
        arms = self._arms
        arms.simulation.show(row, self._picture, configuration=configuration)
        images = [self._image(camera, arms.world(row)) for camera in range(len(arms.robot.cameras))]
        return [self._scene(GROUPS), *images]

    def _image(self, camera: int, world: World) -> Image:
        lens_map = LensMap.of(world, camera, FINER * self._image_size)
        view = lens_map.view(self._renderer.model, camera)
        ((pinhole, _),) = self._renderer.draw([view], GROUPS, shadows=False)
        return reduced(lens_map.colours(pinhole), (self._image_size,) * 2)

    def mark(self, image: Image, camera: int, points: Array, seen: Flags, target: Array) -> None:
        """See `RobotFrame`: of each mark the own one, with the tolerance, and the dock's."""
        tolerance_px = float(self._arms.tolerance) * PIXELS_PER_UNIT
        marks = len(target)
        for mark in range(marks):
            pair = [marks + mark, mark]
            draw_points(image, points[pair, camera], seen[pair, camera], target[mark, camera], tolerance_px)

    def _housing(self, camera: int) -> str:
        return f"{self._arms.robot.cameras[camera]}_camera"

    def _view(self) -> mujoco.MjvCamera:
        """From behind all starts, at their side: the dock as built is at the room's origin."""
        view = mujoco.MjvCamera()
        view.lookat[:] = -0.45, 0.0, 0.35
        view.azimuth, view.elevation, view.distance = -40, -28, 3.3
        return view


class DockViewer(Viewer):
    """A window that shows one base."""

    def _show(self, row: int) -> None:
        self._arms.simulation.show(row, self._picture)
