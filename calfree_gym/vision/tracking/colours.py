"""Which mark's colour a pixel has, whatever its brightness."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.marks import MarkSet

Image = NDArray[Any]
"""uint8: RGB (h, w, 3), or one channel (h, w)."""

SATURATION_SHARE = 0.6
"""Least saturation of a mark's pixel, as a share of the mark's. Choice: with the default marks 0.57, which no
background of saturation 0.3 has, even where the white balance is 15 % off in two channels (0.48)."""
LEAST_CHROMA = 24
"""Least difference between a pixel's largest and smallest channel. Choice: four times a noise of 6 levels."""


def hues_and_saturations(rgb: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Hues (...) in degrees and saturations (...) in [0, 1] of colours (..., 3)."""
    red, green, blue = np.moveaxis(np.asarray(rgb, float), -1, 0)
    largest, spread = np.max(rgb, -1), np.ptp(np.asarray(rgb, float), -1)
    safe = np.where(spread == 0, 1, spread)
    hue = np.where(
        largest == red,
        (green - blue) / safe,
        np.where(largest == green, 2 + (blue - red) / safe, 4 + (red - green) / safe),
    )
    return 60 * hue % 360, spread / np.maximum(largest, 1)


class ColourTable:
    """Gives colours their mark by a table of 2^16 colours, five or six bits a channel.

    Attributes:
        names: Of the marks.

    Args:
        marks: The marks.
        share: Of the difference in hue and in saturation that a pixel may have from its mark, in (0, 1].
    """

    def __init__(self, marks: MarkSet, share: float = 1.0) -> None:
        self.names = marks.names()
        self._share = share
        self._marks = [getattr(marks, name) for name in self.names]
        code = np.arange(1 << 16)
        channels = np.stack([code >> 11, code >> 5 & 63, code & 31], -1)
        self._table = self.marks_of((channels + 0.5) * [8, 4, 8])

    def marks_of(self, rgb: NDArray[Any]) -> NDArray[np.uint8]:
        """The mark (...) that colours (..., 3) belong to, counted from 1; 0 where to none."""
        hue, saturation = hues_and_saturations(rgb)
        gaps = np.stack([np.abs((hue - mark.hue + 180) % 360 - 180) for mark in self._marks])
        vivid = np.ptp(np.asarray(rgb, float), -1) >= LEAST_CHROMA
        nearest = gaps.argmin(0)
        least = 1 - self._share * (1 - SATURATION_SHARE)
        found = np.zeros(hue.shape, np.uint8)
        for i, mark in enumerate(self._marks):
            fits = (gaps[i] <= self._share * mark.hue_tolerance) & (saturation >= least * mark.saturation)
            found[vivid & fits & (nearest == i)] = i + 1
        return found

    def look_up(self, image: Image) -> Image:
        """As `marks_of` (h, w), of an image (h, w, 3), fast."""
        packed = cv2.cvtColor(image, cv2.COLOR_RGB2BGR565)
        codes = np.ascontiguousarray(packed).view(np.uint16)[..., 0]
        return self._table.take(codes)
