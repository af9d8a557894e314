"""What covers table and room: a picture of its own in every world, in colours that no mark has."""

from __future__ import annotations

import colorsys
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

MOST_SATURATED = 0.3
"""Marks are told from their background by saturation; theirs is 0.8 and more."""
DARKEST, BRIGHTEST = 0.25, 0.9
KEPT = 256
"""Pictures that are kept: two a world, so that many rows can be rendered in turns."""
STUDIO = -1
"""Number of the light covers before which people see an arm best; no world's."""
_ROOM, _SQUARES = (211, 221, 233), ((248, 250, 251), (232, 236, 241))
OCTAVES = 5
"""Blotches of five sizes, each half as large as the one before."""


@lru_cache(maxsize=KEPT)
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
