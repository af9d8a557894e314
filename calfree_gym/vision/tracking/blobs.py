"""Pixels that have the colours of marks, and the blobs that they make."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.marks import MarkSet, hue_gap

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
        gaps = np.stack([hue_gap(hue, mark.hue) for mark in self._marks])
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


COARSE_SIZE = 256
"""Blobs are sought in images at least this large. Choice: a ball of radius 4 px in 512 still has 12
pixels."""
LARGEST_BLOB = 0.2
"""Width or height as a share of the image's. Choice: twice that of a ball 30 px in radius in 512, less
blur."""
CANDIDATES = 4
"""Blobs of a colour that are looked at, the largest first. Choice: more cost time, and are specks."""
LEAST_FILLED = 0.2
"""Share that a blob covers of the square about it. Choice: half of a disc covers 0.39; what covers less than
this is an edge, or clutter."""
SLIVER = 5
"""Width of the widest sliver, in px. Choice: the blend of two things under a blur of 1 px."""
_SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Blob:
    """A part of an image that has a mark's colour.

    Attributes:
        corner: Left and upper border of its window, in pixels of the image.
        window: The image around it (h, w, 3).
        mask: 1 in its pixels, holes included, and 0 elsewhere (h, w).
        image_size: Width and height of the image in px.
    """

    corner: tuple[int, int]
    window: Image
    mask: Image
    image_size: tuple[int, int]


def find_blobs(
    image: Image,
    table: ColourTable,
    names: Collection[str],
    largest: float = LARGEST_BLOB,
    filled: float = LEAST_FILLED,
) -> dict[str, list[Blob]]:
    """The blobs of marks' colours in an image, the largest first.

    Args:
        image: (h, w, 3).
        table: Of the marks' colours.
        names: Of the marks that are sought.
        largest: Width or height of a blob at most, as a share of the image's.
        filled: Share that a blob covers at least of the square about it.
    """
    height, width = image.shape[:2]
    factor = max(1, min(height, width) // COARSE_SIZE)
    size = (width // factor, height // factor)
    coarse = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if factor > 1 else image
    codes = table.look_up(cv2.GaussianBlur(coarse, (3, 3), 0.6))
    scale = (width / size[0], height / size[1])
    blobs = {}
    for name in names:
        code = 1 + table.names.index(name)
        shapes = _shapes(cv2.inRange(codes, code, code), largest, filled)
        blobs[name] = [_full_blob(image, shape, at, table, code, scale) for shape, at in shapes]
    return blobs


def _shapes(found: Image, largest: float, filled: float) -> Iterator[tuple[Image, tuple[int, int]]]:
    """The connected parts (h, w) of what was found in the small copy, each with its left and upper border."""
    left, top, width, height = cv2.boundingRect(found)
    if width == 0:
        return
    part = found[top : top + height, left : left + width]
    part = cv2.morphologyEx(part, cv2.MORPH_CLOSE, _SQUARE)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(part)
    longer = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(1)
    areas = stats[:, cv2.CC_STAT_AREA]
    allowed = (longer <= largest * min(found.shape)) & (areas >= filled * longer**2)
    for i in sorted(np.flatnonzero(allowed[1:]) + 1, key=lambda i: -areas[i])[:CANDIDATES]:
        x, y, w, h = (int(v) for v in stats[i, :4])
        shape = labels[y : y + h, x : x + w] == i
        yield shape.astype(np.uint8), (left + x, top + y)


def _full_blob(
    image: Image, shape: Image, at: tuple[int, int], table: ColourTable, code: int, scale: tuple[float, float]
) -> Blob:
    """The blob in the image itself, from its shape in the small copy."""
    height, width = image.shape[:2]
    w, h = round(shape.shape[1] * scale[0]), round(shape.shape[0] * scale[1])
    x, y = round(at[0] * scale[0]), round(at[1] * scale[1])
    margin = 6 + max(w, h) // 3
    x0, y0, x1, y1 = (
        max(x - margin, 0),
        max(y - margin, 0),
        min(x + w + margin, width),
        min(y + h + margin, height),
    )
    near = np.zeros((y1 - y0, x1 - x0), np.uint8)
    inner = near[y - y0 : y - y0 + h, x - x0 : x - x0 + w]
    inner[:] = cv2.resize(shape, (w, h), interpolation=cv2.INTER_NEAREST)[: inner.shape[0], : inner.shape[1]]
    reach = 3 + 2 * round(scale[0])
    near = cv2.dilate(near, np.ones((reach, reach), np.uint8))
    window = np.ascontiguousarray(image[y0:y1, x0:x1])
    colour = table.look_up(cv2.GaussianBlur(window, (3, 3), 0.6)) == code
    mask = cv2.morphologyEx((colour & (near > 0)).astype(np.uint8), cv2.MORPH_CLOSE, _SQUARE)
    mask = _without_slivers(mask)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(mask, outlines, -1, 1, cv2.FILLED)
    return Blob((x0, y0), window, mask, (width, height))


def _without_slivers(mask: Image) -> Image:
    """A mask (h, w) without its thin parts: blended edges of other things, that touch the ball."""
    deepest = float(cv2.distanceTransform(mask, cv2.DIST_L2, 3).max())
    width = min(1 + 2 * int(deepest / 3), SLIVER)
    thick = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((width, width), np.uint8))
    return cv2.dilate(thick, _SQUARE) & mask
