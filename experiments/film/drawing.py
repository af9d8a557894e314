"""A film's pictures: the scene, and both camera images with what is known in them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from PIL import Image as Pictures
from PIL import ImageDraw

from calfree_gym.engine.arms import Arms
from calfree_gym.engine.frames import (
    GRIPPER_COLOUR,
    OBJECT_COLOUR,
    SceneFrame,
    beside,
    draw_points,
)
from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS, IMAGE_SIZE, PIXELS_PER_UNIT
from calfree_gym.vision.image_formation import ImageFormation
from experiments.film.lettering import ALARM, DARK, LIGHT, Image, font

_CROSS = 11.0
"""Half a cross, in pixels of 512."""
_RING = 0.045
"""Radius of the ring around a camera that is changed, as a share of the scene's height."""
_TINT = 0.45
"""So much of a flashing image is the colour of the alarm."""


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


class Alarm(NamedTuple):
    """What has just happened to a camera.

    Attributes:
        camera: Its name; empty, if to none more than to others. Its image has a border.
        now: Whether it happens now: in the scene the camera is ringed.
        flash: Whether its image flashes.
    """

    camera: str = ""
    now: bool = False
    flash: bool = False


NO_ALARM = Alarm()


class Screen:
    """Draws one arm.

    Args:
        arms: The arm, and no other.
        width: Of a picture, in pixels.
        height: Of a picture, in pixels; even.
        sensors: Whether camera images have the light, the blur, exposure and noise by which agents see.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(self, arms: Arms, width: int, height: int, sensors: bool) -> None:
        self._arms = arms
        self._frame = SceneFrame(arms, width, height, sensors)
        self._sensors = ImageFormation(height // 2) if sensors else None
        self._font, self._stroke = font(height / 28), max(1, height // 300)

    def draw(self, configuration: Array | None, marks: Marks | None, alarm: Alarm = NO_ALARM) -> Image:
        """A picture (height, width, 3).

        Args:
            configuration: All that moves (q,), where it is to be other than now.
            marks: What is marked in the images, if anything.
            alarm: What has just happened to a camera, if anything.
        """
        scene, *images = self._frame.views(0, configuration)
        world = self._arms.world(0)
        for camera, name in enumerate(CAMERAS):
            image = images[camera]
            if self._sensors is not None:
                image = self._sensors.image(image, world, camera, np.zeros(2))
            if marks is not None:
                self._mark(image, marks, camera)
            if name == alarm.camera:
                image = _alarmed(image, alarm.flash)
                if alarm.now:
                    place = np.round(self._frame.camera_in_scene(camera)).astype(int).tolist()
                    radius, width = round(_RING * len(scene)), max(2, len(scene) // 120)
                    cv2.circle(scene, place, radius, ALARM, width, cv2.LINE_AA)
            images[camera] = self._named(image, name)
        return beside(scene, images)

    def _mark(self, image: Image, marks: Marks, camera: int) -> None:
        tolerance = float(self._arms.tolerance) * PIXELS_PER_UNIT
        target = marks.target[camera]
        draw_points(image, marks.points[camera::2], marks.seen[camera::2], target, tolerance)
        if marks.predicted is not None:
            draw_crosses(image, marks.predicted[camera::2])

    def _named(self, image: Image, name: str) -> Image:
        picture = Pictures.fromarray(image)
        edge = round(self._font.size / 2)
        ImageDraw.Draw(picture).text(
            (edge, edge), name, LIGHT, self._font, stroke_width=self._stroke, stroke_fill=DARK
        )
        return np.asarray(picture)

    def close(self) -> None:
        """Frees the GL context."""
        self._frame.close()


def _alarmed(image: Image, flash: bool) -> Image:
    """An image of a camera that is changed."""
    if flash:
        image = (image + _TINT * (np.array(ALARM) - image)).astype(np.uint8)
    cv2.rectangle(image, (0, 0), (len(image) - 1,) * 2, ALARM, max(2, len(image) // 40))
    return image


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
