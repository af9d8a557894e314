"""What faults of lens and sensor make of the images that an environment delivers."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import gymnasium as gym
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.vision.cameras import undistort
from calfree_gym.vision.image_formation import Image, ImageFormation
from calfree_gym.world import World

RADII = 512
"""Places along the radius at which a lens is computed. Choice: as many as an image has pixels."""
_BEYOND = -1e4
"""A place outside of any image, which is black."""


def is_colour_image(space: gym.Space[Any] | None) -> bool:
    """Whether these are images of three colours and 8 bits, the colours first or last."""
    return (
        isinstance(space, gym.spaces.Box)
        and space.dtype == np.uint8
        and len(space.shape) == 3
        and 3 in (space.shape[0], space.shape[-1])
    )


def at_fault(world: World, camera: int) -> bool:
    """Whether a camera of a world has a fault that images show."""
    faults = world.lens_k1[camera], world.blur[camera], world.image_noise[camera], world.exposure[camera] - 1
    return any(faults)


def faulty(image: Image, world: World, camera: int, place: Array) -> Image:
    """The image (h, w, 3) or (3, h, w) that a camera delivers.

    Args:
        image: What it would be without fault.
        world: In which it is. Pixels of 512 are of the longer side, focal lengths of the rows.
        camera: Its place in `world`.
        place: Two numbers in [0, 1): where in the tile of noise.
    """
    if image.shape[-1] != 3:
        colours_last = np.ascontiguousarray(np.moveaxis(image, 0, -1))
        return np.moveaxis(faulty(colours_last, world, camera, place), -1, 0)
    height, width, _ = image.shape
    if k1 := float(world.lens_k1[camera]):
        where = _lens(height, width, float(world.focal_length[camera]), k1)
        image = np.asarray(cv2.remap(image, *where, cv2.INTER_LINEAR), np.uint8)
    return _formation(height, width).image(image, world, camera, place)


@lru_cache(maxsize=8)
def _formation(height: int, width: int) -> ImageFormation:
    return ImageFormation(width, height)


@lru_cache(maxsize=8)
def _lens(height: int, width: int, focal: float, k1: float) -> tuple[Array, Array]:
    """Where in a pinhole image each pixel (h, w) comes from: column and row."""
    half = np.array([width - 1, height - 1]) / 2
    pixels = np.stack(np.meshgrid(*map(np.arange, (width, height))), -1) - half
    radii = np.sqrt((pixels**2).sum(-1)) / (focal * height / IMAGE_SIZE)
    table = np.linspace(0, radii.max(), RADII)
    flat, shown = undistort(np.stack([table, np.zeros(RADII)], -1), k1, 0.0)
    ratios = flat[1:, 0] / table[1:]
    places = pixels * np.interp(radii, table[1:], ratios)[..., None] + half
    places[radii > table[shown].max()] = _BEYOND
    column, row = np.moveaxis(places.astype(np.float32), -1, 0)
    return np.ascontiguousarray(column), np.ascontiguousarray(row)
