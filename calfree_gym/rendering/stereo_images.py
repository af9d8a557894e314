"""What the cameras of N worlds see, through their lenses: one model and one GL context for all."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.rendering.renderer import FREE_NAMES, Image, Picture, Renderer, View
from calfree_gym.robot.arms.robot import Rig
from calfree_gym.robot.rays import SEEN
from calfree_gym.robot.simulation import Simulation
from calfree_gym.vision.cameras import undistort
from calfree_gym.world.value import BUILT_LIGHT, World

LAMP_FAR = 2.0
"""From the middle of the work space to the lamp (m, for the RV-M2)."""
LIT = 0.7
"""So far around it there are shadows (m, likewise)."""
RADII = 2048
"""Entries of the table of radii: between them a pinhole point is interpolated, to 0.001 px."""
_NO_SHARES = np.empty(0, np.uint16)
MARGIN, MARGIN_PX = 0.01, 1.1
"""A pinhole image is wider than what the lens shows: by this share, or, where pixels are few, by so many (the
outermost are seen at their middles). Choice."""
LARGEST = 2.0
"""A pinhole image is at most so much wider than the lens's; beyond that it is coarser instead."""
MOST_SATURATED = 0.3
"""Marks are told from their background by saturation; theirs is 0.8 and more."""
DARKEST, BRIGHTEST = 0.25, 0.9
KEPT = 256
"""Worlds, at most, whose covers OpenGL keeps. Choice: some 100 MB."""
STUDIO = -1
"""Number of the light covers before which people see an arm best; no world's."""
_ROOM, _SQUARES = (211, 221, 233), ((248, 250, 251), (232, 236, 241))
OCTAVES = 5
"""Blotches of five sizes, each half as large as the one before."""


class Lighting(NamedTuple):
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
    def of(cls, world: World) -> Lighting:
        """The light that cameras see a world in."""
        strengths = float(world.light_strength), float(world.light_ambient)
        return cls(world.light_direction, *strengths, int(world.texture))


FOR_PEOPLE = Lighting(BUILT_LIGHT, 0.4, 0.58, STUDIO)
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
        self._cameras = [model.camera(prefix + name).id for name in simulation.cameras]
        self._lamp = model.light(prefix + "lamp").id
        model.vis.map.shadowclip = LIT * rig.scale / model.stat.extent
        self._textures = [model.texture(name).id for name in simulation.covers]
        self._built = [pixels.copy() for pixels in map(self._pixels, self._textures)]
        self._covers: dict[int, int] = {}
        self._worlds: list[World | None] = [None] * simulation.rows
        self._lenses: list[tuple[LensMap, ...]] = [()] * simulation.rows

    def colours(
        self,
        row: int,
        world: World,
        groups: Sequence[int] = SEEN,
        configuration: Array | None = None,
        light: Lighting | None = None,
    ) -> tuple[Image, ...]:
        """Images (size, size, 3), one a camera, such as left and right; see `exposed`."""
        exposed = self.exposed(row, world, groups, configuration, light)
        return tuple(lens.colours(image) for lens, image in exposed)

    def exposed(
        self,
        row: int,
        world: World,
        groups: Sequence[int] = SEEN,
        configuration: Array | None = None,
        light: Lighting | None = None,
    ) -> Exposure:
        """Each camera's lens, and the pinhole image behind it, as the simulation is now.

        Args:
            row: The row.
            world: In which it is.
            groups: Of the geoms that are shown.
            configuration: All that moves (q,), where it is to be other than now.
            light: Where it is to be another than the world's.
        """
        lenses = self.prepare(row, world, configuration, light)
        pictures = self._pinholes(lenses, groups)
        return [(lens, image) for lens, (image, _) in zip(lenses, pictures, strict=True)]

    def depths(self, row: int, world: World) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Depths (size, size) along each camera's axis in m; 0 where its lens shows nothing."""
        lenses = self.prepare(row, world)
        pictures = self._pinholes(lenses, SEEN, depth=True)
        left, right = (
            lens.depths(depths)  # type: ignore[arg-type]
            for lens, (_, depths) in zip(lenses, pictures, strict=True)
        )
        return left, right

    def prepare(
        self, row: int, world: World, configuration: Array | None = None, light: Lighting | None = None
    ) -> tuple[LensMap, ...]:
        """Lights and covers the row's scene, as it is now or in a configuration (q,); its lenses."""
        if self._worlds[row] is not world:
            self._worlds[row] = world
            self._lenses[row] = tuple(LensMap.of(world, i, self.size) for i in range(len(self._cameras)))
        self.shine(light or Lighting.of(world))
        self._simulation.show(row, self.picture, configuration=configuration)
        return self._lenses[row]

    def shine(self, light: Lighting) -> None:
        """Lights and covers the picture."""
        model, lamp, rig = self.renderer.model, self._lamp, self._rig
        model.light_dir[lamp] = light.direction
        model.light_pos[lamp] = rig.target - LAMP_FAR * rig.scale * light.direction
        model.light_diffuse[lamp] = light.strength
        model.vis.headlight.ambient[:] = light.ambient
        self._cover(light.texture)

    def _pinholes(
        self, lenses: Sequence[LensMap], groups: Sequence[int], depth: bool = False
    ) -> list[Picture]:
        model, views = self.renderer.model, []
        for place, lens in zip(self._cameras, lenses, strict=True):
            views.append(lens.view(model, place))
        return self.renderer.draw(views, groups, self._shadows and not depth, depth)

    def _cover(self, number: int) -> None:
        """Covers table and room with other pictures; OpenGL keeps the latest: a world a row, and one more."""
        kept = number in self._covers
        full = len(self._covers) > min(self._simulation.rows, KEPT)
        if kept or full:
            slot = self._covers.pop(number if kept else next(iter(self._covers)))
        else:
            slot = len(self._covers)
        self._covers[number] = slot  # the latest stands last
        for i, texture in enumerate(self._textures):
            name = FREE_NAMES + slot * len(self._textures) + i
            self.renderer.use_texture(texture, name, None if kept else self._picture(number, i))

    def _picture(self, number: int, i: int) -> Image:
        """The pixels (height, width, 3) of the cover of the table, or of the room."""
        height, width, _ = self._built[i].shape
        if number == STUDIO:
            return studio(height, width)
        return texture(number + i, height, width) if number else self._built[i]

    def _pixels(self, texture: int) -> Image:
        model = self.renderer.model
        shape = model.tex_height[texture], model.tex_width[texture], 3
        first = model.tex_adr[texture]
        return model.tex_data[first : first + np.prod(shape)].reshape(shape)

    def close(self) -> None:
        """Frees the GL context."""
        self.renderer.close()


class LensMap(NamedTuple):
    """One camera's map from pixels of its image to pixels of a pinhole image, which has the same middle.

    Attributes:
        half: Tangent of half the pinhole image's field of view.
        source: Width and height of the pinhole image in pixels.
        places: Whole pixels, for `cv2.remap`.
        shares: Of pixels, likewise.
        nearest: Whole pixels where no shares are taken.
    """

    half: float
    source: int
    places: NDArray[np.int16]
    shares: NDArray[np.uint16]
    nearest: NDArray[np.int16]

    @classmethod
    def of(cls, world: World, camera: int, size: int) -> LensMap:
        """The map of a camera of a world for images of `size` pixels in width and height."""
        focal_px = size / IMAGE_SIZE * world.focal_length[camera]
        aspect = world.pixel_aspect[camera]
        pixels = np.arange(size) + 0.5 - size / 2
        x, y = (pixels - size / IMAGE_SIZE * offset for offset in world.principal_point[camera])
        x, y = x / focal_px, y[:, None] / (focal_px * aspect)
        radii = np.sqrt(x * x + y * y)
        table = np.linspace(0.0, radii.max(), RADII)
        lens = world.lens_k1[camera], world.lens_k2[camera]
        flat, shown = undistort(np.stack([table, np.zeros(RADII)], -1), *lens)
        with np.errstate(invalid="ignore"):
            stretch = np.where(table > 0, flat[:, 0] / table, 1.0)
        end = table[shown].max()
        stretch = np.where(radii <= end, np.interp(radii, table, stretch), np.nan)
        x, y = x * stretch, y * stretch
        shown_half = float(max(np.nanmax(np.abs(x)), np.nanmax(np.abs(y))))
        half = (1 + MARGIN) * shown_half
        source = int(min(np.ceil(2 * half * focal_px * max(1.0, aspect)), np.ceil(LARGEST * size)))
        half = max(half, shown_half * source / (source - MARGIN_PX))
        columns, rows = ((way / half + 1) * source / 2 - 0.5 for way in (x, -y))
        columns, rows = (np.where(np.isnan(way), -10, way).astype(np.float32) for way in (columns, rows))
        places, shares = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
        nearest, _ = cv2.convertMaps(columns, rows, cv2.CV_16SC2, nninterpolation=True)
        maps = np.asarray(places, np.int16), np.asarray(shares, np.uint16), np.asarray(nearest, np.int16)
        return cls(half, source, *maps)

    def view(self, model: mujoco.MjModel, camera: int) -> View:
        """Of the pinhole image that a camera of a model takes, whose field of view is made as wide."""
        model.cam_intrinsic[camera] = [model.cam_sensorsize[camera, 0] / (2 * self.half)] * 2 + [0, 0]
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        return View(view, self.source, self.source)

    def colours(self, pinhole: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The lens's image (size, size, 3) of a pinhole image, upside down; black where it shows nothing."""
        return np.asarray(cv2.remap(pinhole, self.places, self.shares, cv2.INTER_LINEAR), np.uint8)

    def depths(self, pinhole: NDArray[np.float32]) -> NDArray[np.float32]:
        """The same of depths (size, size): those of the nearest pixels."""
        return np.asarray(cv2.remap(pinhole, self.nearest, _NO_SHARES, cv2.INTER_NEAREST), np.float32)


Exposure = list[tuple[LensMap, Image]]
"""Lenses, and the pinhole images (source, source, 3) from which they make a camera's image each."""


def texture(number: int, height: int, width: int) -> NDArray[np.uint8]:
    """Blotches of two colours (height, width, 3); the same number gives the same picture."""
    rng = np.random.default_rng(number)
    field = np.zeros((height, width), np.float32)
    for octave in range(OCTAVES):
        cells = 2 ** (octave + 1)
        blotches = rng.random((cells, cells), np.float32)
        strength = rng.uniform(0.2, 1) / (octave + 1)
        field += strength * cv2.resize(blotches, (width, height), interpolation=cv2.INTER_CUBIC)
    field -= field.min()
    field /= field.max()
    first, second = (
        255
        * np.array(
            colorsys.hsv_to_rgb(rng.random(), rng.uniform(0, MOST_SATURATED), rng.uniform(DARKEST, BRIGHTEST))
        )
        for _ in range(2)
    )
    return np.asarray(first + field[..., None] * (second - first), np.uint8)


def studio(height: int, width: int) -> NDArray[np.uint8]:
    """A light cover (height, width, 3): of a table, which is square, four squares; of a room one colour."""
    if height != width:
        return np.full((height, width, 3), _ROOM, np.uint8)
    cover, half = np.full((height, width, 3), _SQUARES[0], np.uint8), height // 2
    cover[:half, :half] = cover[half:, half:] = _SQUARES[1]
    return cover
