"""What the cameras of N worlds see, through their lenses: one model and one GL context for all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.rendering.lens_map import LensMap
from calfree_gym.envs.rendering.renderer import Image, Renderer
from calfree_gym.envs.rendering.textures import STUDIO, studio, texture
from calfree_gym.geometry import Array
from calfree_gym.image import CAMERAS
from calfree_gym.robot.line_of_sight import SEEN
from calfree_gym.world.value import BUILT_LIGHT

if TYPE_CHECKING:
    from calfree_gym.robot.arms.robot import Rig
    from calfree_gym.robot.simulation import Simulation
    from calfree_gym.world import World

LAMP_FAR = 2.0
"""From the middle of the work space to the lamp (m, for the RV-M2)."""
LIT = 0.7
"""So far around it there are shadows (m, likewise)."""


class Light(NamedTuple):
    """How a scene is lit, and what covers table and room.

    Attributes:
        direction: Where the lamp shines (3,), of unit length, in the room.
        strength: How brightly it lights what faces it, relative to white.
        ambient: How brightly all is lit from everywhere, likewise.
        texture: Number of the pictures that cover table and room, see `textures`; 0: as built.
    """

    direction: Array
    strength: float
    ambient: float
    texture: int

    @classmethod
    def of(cls, world: World) -> Light:
        """The light that cameras see a world in."""
        strengths = float(world.light_strength), float(world.light_ambient)
        return cls(world.light_direction, *strengths, int(world.texture))


FOR_PEOPLE = Light(BUILT_LIGHT, 0.4, 0.58, STUDIO)
"""The light in which people see every world alike, on a light table. Choice."""


class StereoImages:
    """Renders the images of any row.

    Attributes:
        size: Width and height of an image in pixels.
        picture: Model and state of the row that was rendered last.
        renderer: Draws it.

    Args:
        simulation: The N worlds.
        rig: Where the lamp is to light up the room.
        size: Width and height of an image in pixels.
        shadows: Whether the lamp casts shadows.
        for_people: See `Renderer`.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(
        self, simulation: Simulation, rig: Rig, size: int, shadows: bool = True, for_people: bool = False
    ) -> None:
        self.size, self._rig = size, rig
        self._simulation, self._shadows = simulation, shadows
        self.picture = simulation.picture()
        self.renderer = Renderer(*self.picture, size, for_people)
        model, prefix = self.renderer.model, simulation.prefix
        self._cameras = [model.camera(prefix + name).id for name in CAMERAS]
        self._lamp = model.light(prefix + "lamp").id
        model.vis.map.shadowclip = LIT * rig.scale / model.stat.extent
        self._textures = [model.texture(name).id for name in simulation.covers]
        self._built = model.tex_data.copy()
        self._covered_by = 0
        self._worlds: list[World | None] = [None] * simulation.rows
        self._lenses: list[tuple[LensMap, ...]] = [()] * simulation.rows

    def colours(
        self,
        row: int,
        world: World,
        groups: Sequence[int] = SEEN,
        configuration: Array | None = None,
        light: Light | None = None,
    ) -> tuple[Image, Image]:
        """Images (size, size, 3), left and right, as the simulation is now.

        Args:
            row: The row.
            world: In which it is.
            groups: Of the geoms that are shown.
            configuration: All that moves (q,), where it is to be other than now.
            light: Where it is to be another than the world's.
        """
        left, right = (
            lens.colours(self._pinhole(camera, lens, groups)[0])
            for camera, lens in enumerate(self.prepare(row, world, configuration, light))
        )
        return left, right

    def depths(self, row: int, world: World) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Depths (size, size) along each camera's axis in m; 0 where its lens shows nothing."""
        left, right = (
            lens.depths(self._pinhole(camera, lens, SEEN, depth=True)[1])  # type: ignore[arg-type]
            for camera, lens in enumerate(self.prepare(row, world))
        )
        return left, right

    def prepare(
        self, row: int, world: World, configuration: Array | None = None, light: Light | None = None
    ) -> tuple[LensMap, ...]:
        """Lights and covers the row's scene, as it is now or in a configuration (q,); its lenses."""
        if self._worlds[row] is not world:
            self._worlds[row] = world
            cameras = zip(world.focal_length, world.principal_point, world.lens_k1, strict=True)
            self._lenses[row] = tuple(LensMap.of(*camera, self.size) for camera in cameras)
        self.shine(light or Light.of(world))
        self._simulation.show(row, self.picture, configuration=configuration)
        return self._lenses[row]

    def shine(self, light: Light) -> None:
        """Lights and covers the picture."""
        model, lamp, rig = self.renderer.model, self._lamp, self._rig
        model.light_dir[lamp] = light.direction
        model.light_pos[lamp] = rig.target - LAMP_FAR * rig.scale * light.direction
        model.light_diffuse[lamp] = light.strength
        model.vis.headlight.ambient[:] = light.ambient
        self._cover(light.texture)

    def _pinhole(
        self, camera: int, lens: LensMap, groups: Sequence[int], depth: bool = False
    ) -> tuple[Image, NDArray[np.float32] | None]:
        model, place = self.renderer.model, self._cameras[camera]
        model.cam_intrinsic[place] = [model.cam_sensorsize[place, 0] / (2 * lens.half)] * 2 + [0, 0]
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, place
        return self.renderer.draw(view, lens.source, lens.source, groups, self._shadows, depth)

    def _cover(self, number: int) -> None:
        """Covers table and room with another picture."""
        if number == self._covered_by:
            return
        self._covered_by, model = number, self.renderer.model
        for i, place in enumerate(self._textures):
            height, width = model.tex_height[place], model.tex_width[place]
            pixels = slice(model.tex_adr[place], model.tex_adr[place] + 3 * height * width)
            if number == STUDIO:
                model.tex_data[pixels] = studio(height, width).ravel()
            elif number:
                model.tex_data[pixels] = texture(number + i, height, width).ravel()
            else:
                model.tex_data[pixels] = self._built[pixels]
            self.renderer.upload_texture(place)

    def close(self) -> None:
        """Frees the GL context."""
        self.renderer.close()
