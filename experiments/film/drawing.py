"""A film's pictures: the scene, both camera images with what is known in them, a caption, announcements."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from calfree_gym.envs.arms.base import Arms
from calfree_gym.envs.rendering.scene_frame import (
    GRIPPER_COLOUR,
    OBJECT_COLOUR,
    SceneFrame,
    beside,
    draw_points,
)
from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS, IMAGE_SIZE, PIXELS_PER_UNIT
from calfree_gym.vision.image_formation import ImageFormation

Image = NDArray[np.uint8]

DARK, LIGHT = (30, 30, 34), (240, 240, 240)
ALARM, SUCCESS = (214, 84, 20), (120, 225, 140)
COLOURS = (DARK, LIGHT, ALARM, SUCCESS, GRIPPER_COLOUR, OBJECT_COLOUR, (255, 255, 255), (0, 0, 0))
"""All that is drawn, but for the scene."""
LEGEND = (("gripper", GRIPPER_COLOUR), ("object", OBJECT_COLOUR), ("rings: seen   crosses: predicted", LIGHT))
"""From the left, in the scene's lower corner."""
_CROSS = 11.0
"""Half a cross, in pixels of 512."""


class Marks(NamedTuple):
    """What is marked in the images.

    Attributes:
        points: Where points were seen last (4, 2), in image units: gripper left, right, object left, right.
        seen: Which of them are seen now (4,).
        target: Around which the task is done (2, 2), left and right.
        predicted: Where they are expected (4, 2), NaN where they are not; or None.
    """

    points: Array
    seen: Flags
    target: Array
    predicted: Array | None = None

    def lingering(self, predicted: Array | None) -> Marks:
        """While the arm moves: nothing is seen, and all stays where it was seen last."""
        return Marks(self.points, np.zeros_like(self.seen), self.target, predicted)


class Words(NamedTuple):
    """What a picture says.

    Attributes:
        caption: Below.
        good: Whether that is good news.
        announced: Across the scene; nothing, if empty.
        camera: In which image it is to be seen; empty, if in none more than in others.
    """

    caption: str
    good: bool = False
    announced: str = ""
    camera: str = ""


class Screen:
    """Draws one arm.

    Args:
        arms: The arm, and no other.
        width: Of a picture, in pixels.
        height: Of a picture, in pixels; even.
        caption: Height of its caption, in pixels; even.
        sensors: Whether camera images have the blur, exposure and noise of the cameras.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(self, arms: Arms, width: int, height: int, caption: int, sensors: bool) -> None:
        self._arms, self._caption = arms, caption
        self._frame = SceneFrame(arms, width, height - caption, sensors)
        self._sensors = ImageFormation((height - caption) // 2) if sensors else None
        self._edge, self._stroke = round(0.35 * caption), max(1, caption // 30)
        self._font, self._small = _font(0.4 * caption), _font(0.32 * caption)

    def draw(self, configuration: Array | None, marks: Marks | None, words: Words) -> Image:
        """A picture (height, width, 3).

        Args:
            configuration: All that moves (q,), where it is to be other than now.
            marks: What is marked in the images, if anything.
            words: What it says.
        """
        scene, *images = self._frame.views(0, configuration)
        scene = self._explained(scene, words.announced)
        world = self._arms.world(0)
        for camera, name in enumerate(CAMERAS):
            image = images[camera]
            if self._sensors is not None:
                image = self._sensors.image(image, world, camera, np.zeros(2))
            if marks is not None:
                self._mark(image, marks, camera)
            if name == words.camera:
                cv2.rectangle(image, (0, 0), (len(image) - 1,) * 2, ALARM, max(2, len(image) // 45))
            images[camera] = self._named(image, name)
        frame = beside(scene, images)
        return np.vstack([frame, self._captioned(frame.shape[1], words)])

    def _mark(self, image: Image, marks: Marks, camera: int) -> None:
        tolerance = float(self._arms.tolerance) * PIXELS_PER_UNIT
        target = marks.target[camera]
        draw_points(image, marks.points[camera::2], marks.seen[camera::2], target, tolerance)
        if marks.predicted is not None:
            draw_crosses(image, marks.predicted[camera::2])

    def _captioned(self, width: int, words: Words) -> Image:
        picture = Pictures.new("RGB", (width, self._caption), DARK)
        draw, edge = ImageDraw.Draw(picture), self._edge
        font = _fitting(words.caption, self._font, width - 2 * edge)
        colour = SUCCESS if words.good else LIGHT
        draw.text((edge, self._caption // 2), words.caption, colour, font, anchor="lm")
        return np.asarray(picture)

    def _explained(self, scene: Image, announced: str) -> Image:
        """The scene, with what is announced and the legend."""
        picture = Pictures.fromarray(scene)
        draw, height = ImageDraw.Draw(picture), self._caption
        if announced:
            font = _fitting(announced, self._font, picture.width - 2 * self._edge)
            draw.rectangle((0, 0, picture.width, height), ALARM)
            draw.text((picture.width // 2, height // 2), announced, (255, 255, 255), font, anchor="mm")
        x, middle = float(self._edge), picture.height - height // 3
        width = self._small.getlength("   ".join(text for text, _ in LEGEND))
        draw.rectangle((0, picture.height - 2 * height // 3, x + width + self._edge, picture.height), DARK)
        for text, colour in LEGEND:
            draw.text((x, middle), text, colour, self._small, anchor="lm")
            x += self._small.getlength(text + "   ")
        return np.asarray(picture)

    def _named(self, image: Image, name: str) -> Image:
        picture = Pictures.fromarray(image)
        place = self._edge // 2, self._edge // 2
        ImageDraw.Draw(picture).text(
            place, name, LIGHT, self._small, stroke_width=self._stroke, stroke_fill=DARK
        )
        return np.asarray(picture)

    def close(self) -> None:
        """Frees the GL context."""
        self._frame.close()


def _font(size: float) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont), "Pillow has one of any size where it has FreeType"
    return font


def _fitting(text: str, font: ImageFont.FreeTypeFont, width: float) -> ImageFont.FreeTypeFont:
    """The font, or a smaller one where text would be wider than `width` pixels."""
    return _font(font.size * width / max(width, font.getlength(text)))


def draw_crosses(image: Image, points: Array) -> None:
    """Draws a cross at the gripper and object points (2, 2), but where they are NaN.

    Args:
        image: A camera's (size, size, 3); it is drawn on.
        points: In image units.
    """
    size = len(image)
    half = max(2, round(_CROSS * size / IMAGE_SIZE))
    for point, colour in zip(points, (GRIPPER_COLOUR, OBJECT_COLOUR), strict=True):
        if not np.isfinite(point).all() or np.abs(point).max() > 1:
            continue
        x, y = np.round((point + 1) * size / 2 - 0.5).astype(int).tolist()
        for shade, thickness in (((255, 255, 255), 4), (colour, 2)):
            cv2.line(image, (x - half, y), (x + half, y), shade, thickness, cv2.LINE_AA)
            cv2.line(image, (x, y - half), (x, y + half), shade, thickness, cv2.LINE_AA)
