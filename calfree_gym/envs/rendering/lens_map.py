"""Where in a pinhole image each pixel of a lens's image comes from."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.vision.cameras import undistort

RADII = 2048
"""Entries of the table of radii: between them a pinhole point is interpolated, to 0.001 px."""
_NO_SHARES = np.empty(0, np.uint16)
MARGIN, MARGIN_PX = 0.01, 1.1
"""A pinhole image is wider than what the lens shows: by this share, or, where pixels are few, by so many (the
outermost are seen at their middles). Choice."""
LARGEST = 2.0
"""A pinhole image is at most so much wider than the lens's; beyond that it is coarser instead."""


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
    def of(cls, focal_length: float, principal_point: Array, k1: float, size: int) -> LensMap:
        """The map of a camera for images of `size` pixels.

        Args:
            focal_length: In pixels of an image of 512.
            principal_point: Offset (2,) in such pixels.
            k1: Radial distortion.
            size: Width and height of the image in pixels.
        """
        scale = size / IMAGE_SIZE
        pixels = np.arange(size) + 0.5 - size / 2
        x, y = (pixels - scale * offset for offset in principal_point)
        x, y = x / (scale * focal_length), y[:, None] / (scale * focal_length)
        radii = np.sqrt(x * x + y * y)
        table = np.linspace(0.0, radii.max(), RADII)
        flat, shown = undistort(np.stack([table, np.zeros(RADII)], -1), k1)
        with np.errstate(invalid="ignore"):
            stretch = np.where(table > 0, flat[:, 0] / table, 1.0)
        end = table[shown].max()
        stretch = np.where(radii <= end, np.interp(radii, table, stretch), np.nan)
        x, y = x * stretch, y * stretch
        shown_half = float(max(np.nanmax(np.abs(x)), np.nanmax(np.abs(y))))
        half = (1 + MARGIN) * shown_half
        source = int(min(np.ceil(2 * half * scale * focal_length), np.ceil(LARGEST * size)))
        half = max(half, shown_half * source / (source - MARGIN_PX))
        columns, rows = ((way / half + 1) * source / 2 - 0.5 for way in (x, -y))
        columns, rows = (np.where(np.isnan(way), -10, way).astype(np.float32) for way in (columns, rows))
        places, shares = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
        nearest, _ = cv2.convertMaps(columns, rows, cv2.CV_16SC2, nninterpolation=True)
        maps = np.asarray(places, np.int16), np.asarray(shares, np.uint16), np.asarray(nearest, np.int16)
        return cls(half, source, *maps)

    def colours(self, pinhole: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The lens's image (size, size, 3) of a pinhole image, upside down; black where it shows nothing."""
        return np.asarray(cv2.remap(pinhole, self.places, self.shares, cv2.INTER_LINEAR), np.uint8)

    def depths(self, pinhole: NDArray[np.float32]) -> NDArray[np.float32]:
        """The same of depths (size, size): those of the nearest pixels."""
        return np.asarray(cv2.remap(pinhole, self.nearest, _NO_SHARES, cv2.INTER_NEAREST), np.float32)
