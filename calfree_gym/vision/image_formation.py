"""From the light on a camera's sensor to the image that it delivers: blur, exposure, noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array
from calfree_gym.image import IMAGE_SIZE

if TYPE_CHECKING:
    from calfree_gym.world.value import World

Image = NDArray[np.uint8]

MAX_NOISE = 30.0
"""Largest standard deviation of the noise that is exact, in grey levels: the tile's ends are signed bytes."""
_STEPS = 32
"""Grey levels of the noise tile in a standard deviation."""
_SPARE = 64
"""Pixels by which the tile is larger than an image: so many places has it in either direction."""
_LEVELS = np.arange(256)


class ImageFormation:
    """The sensors of cameras whose images have one size.

    Noise comes from one large tile of it, at another place in every image: to draw it anew takes longer than
    to render the image.

    Args:
        width: Of an image in pixels.
        height: The same where None is given.
    """

    def __init__(self, width: int, height: int | None = None) -> None:
        self._width, self._height = width, width if height is None else height
        self._scale = max(self._width, self._height) / IMAGE_SIZE
        shape = self._height + _SPARE, self._width + _SPARE, 3
        normal = np.random.default_rng(0).standard_normal(shape, np.float32)
        self._tile = np.clip(128 + _STEPS * normal, 0, 255).astype(np.uint8)

    def image(self, light: Image, world: World, camera: int, place: Array) -> Image:
        """The image (height, width, 3) that a camera delivers.

        Args:
            light: What its sensor would show without fault (height, width, 3).
            world: In which it is.
            camera: Its place in the world, such as 0, left, or 1, right.
            place: Two numbers in [0, 1): where in the tile of noise.
        """
        sigma = self._scale * float(world.blur[camera])
        image = cv2.GaussianBlur(light, (0, 0), sigma) if sigma > 0 else light
        exposure = float(world.exposure[camera])
        if exposure != 1:
            image = cv2.LUT(image, np.clip(exposure * _LEVELS, 0, 255).astype(np.uint8))
        noise = float(world.image_noise[camera])
        if noise > 0:
            column, row = (_SPARE * place).astype(int)
            tile = self._tile[row : row + self._height, column : column + self._width]
            grey = np.clip(np.round(noise * (_LEVELS - 128) / _STEPS), -128, 127).astype(np.int8)
            image = cv2.add(image, cv2.LUT(tile, grey), dtype=cv2.CV_8U)
        return np.asarray(image, np.uint8)
