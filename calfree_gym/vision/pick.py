"""Learns a mark's colour from a box in one's own picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calfree_gym.errors import check_choice
from calfree_gym.errors.yaml_values import read
from calfree_gym.image import rounded
from calfree_gym.vision.marks import LEAST_SATURATION, MARK_NAMES, Mark, Marks, hue_gap, write_yaml
from calfree_gym.vision.tracking.blobs import LEAST_CHROMA, Image, hues_and_saturations
from calfree_gym.vision.tracking.tracker import BallFinder

SMALLEST_BOX = 3
"""Width and height in px. Choice: the smallest ball that the tracker finds well."""
SMOOTHING = 15.0
"""Of the histogram of hues, in degrees. Choice: about the spread of hues over one ball."""


@dataclass(frozen=True)
class Pick:
    """What was learned.

    Attributes:
        mark: The mark's colour.
        marks: All marks of the file, with it.
        found: Where the tracker finds it in the picture, (x, y, radius) in px from the upper left corner, if
            it does.
        in_box: Whether that is in the box.
    """

    mark: Mark
    marks: Marks
    found: tuple[float, float, float] | None
    in_box: bool


def pick(picture: Path, box: Sequence[int], name: str, file: Path) -> Pick:
    """Learns the colour of one mark, and writes it into a file of marks, whose other marks stay.

    Args:
        picture: An image file.
        box: Around the mark: left, upper border, width, height, in px.
        name: One of `MARK_NAMES`.
        file: YAML; made where it is missing.

    Raises:
        ImportError: PyYAML is not installed.
        OSError: A file cannot be read or written.
        ValueError: The picture is no image, the box is not within it, the file holds no marks, or the colour
            is grey, dark, or too like another mark's.
    """
    check_choice("mark", name, MARK_NAMES)
    image = read_image(picture)
    mark = learn_mark(image, box)
    values: dict[str, Any] = {}
    if file.exists():
        Marks.load(file)
        values = read(file.read_text(encoding="utf-8"))
    values[name] = mark.to_dict()
    marks = Marks.from_dict(values)
    write_yaml(file, values)
    ball = BallFinder(marks)(image).get(name)
    if ball is None:
        return Pick(mark, marks, None, False)
    x, y = (float(v) for v in ball.centre)
    left, top, width, height = box
    in_box = left <= x <= left + width and top <= y <= top + height
    return Pick(mark, marks, (x, y, float(np.sqrt(ball.area / np.pi))), in_box)


def read_image(picture: Path) -> Image:
    """RGB (h, w, 3) of an image file.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no image that OpenCV knows.
    """
    try:
        data = np.frombuffer(picture.read_bytes(), np.uint8)
    except FileNotFoundError:
        raise FileNotFoundError(f"{picture}: there is no such file") from None
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if image is None:
        raise ValueError(f"{picture} is no image; allowed: what OpenCV reads, such as PNG and JPEG")
    return np.ascontiguousarray(image[..., ::-1], np.uint8)


def learn_mark(image: Image, box: Sequence[int]) -> Mark:
    """The colour of the ball in a box, which may hold background too.

    Pixels vote for their hues, the vivid ones more, and those in the middle of the box more. The mark has the
    median colour of the more saturated half of the pixels that have the winning hue.

    Args:
        image: RGB (h, w, 3).
        box: Left, upper border, width, height, in px.

    Raises:
        ValueError: The box is not within the image, or its colours are grey or dark.
    """
    left, top, width, height = box
    h, w = image.shape[:2]
    if min(width, height) < SMALLEST_BOX:
        raise ValueError(
            f"the box is {width} × {height} px; it must be {SMALLEST_BOX} × {SMALLEST_BOX} or more"
        )
    if left < 0 or top < 0 or left + width > w or top + height > h:
        raise ValueError(
            f"the box from ({left}, {top}) to ({left + width}, {top + height}) is not within the image of "
            f"{w} × {h} px"
        )
    part = image[top : top + height, left : left + width]
    smooth = cv2.GaussianBlur(part, (3, 3), 0.6).reshape(-1, 3)
    hue, saturation = hues_and_saturations(smooth)
    chroma = np.ptp(smooth.astype(float), -1)
    where = f"in the box at ({left}, {top})"
    if chroma.max() < LEAST_CHROMA:
        raise ValueError(
            f"the pixels {where} are too grey or too dark to be told from a background: their channels "
            f"differ by {chroma.max():.0f} of 255 at most; it must be {LEAST_CHROMA} or more"
        )
    y, x = np.mgrid[-1 : 1 : 1j * height, -1 : 1 : 1j * width]
    votes = (chroma >= LEAST_CHROMA) * saturation**2 * chroma * np.exp(-(x * x + y * y)).ravel()
    winner = _mode(hue, votes)
    near = hue_gap(hue, winner)
    same = (near <= 2 * SMOOTHING) & (chroma >= LEAST_CHROMA)
    vivid = same & (saturation >= np.median(saturation[same]))
    red, green, blue = (round(v) for v in np.median(smooth[vivid], 0))
    spread = float(np.quantile(near[vivid], 0.95))
    try:
        return Mark((red, green, blue), float(np.clip(10 + 2 * spread, Mark.hue_tolerance, 60)))
    except ValueError:
        saturation_found = (max(red, green, blue) - min(red, green, blue)) / max(red, green, blue)
        raise ValueError(
            f"the colour {where} is ({red}, {green}, {blue}), with saturation {saturation_found:.2f}, too "
            f"grey to be told from a background; it must be {LEAST_SATURATION} or more"
        ) from None


def _mode(hue: Any, votes: Any) -> float:
    """The hue in degrees with the most votes around it."""
    counts = np.bincount(np.round(hue).astype(int) % 360, votes, 360)
    apart = (np.arange(360) + 180) % 360 - 180
    kernel = np.exp(-0.5 * (apart / SMOOTHING) ** 2)
    near = np.fft.irfft(np.fft.rfft(counts) * np.fft.rfft(kernel), 360)
    return float(rounded(near).argmax())
