"""What a tracker sees, drawn into the pictures of both cameras."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.picture_reach import Array, PictureLook

Image = NDArray[np.uint8]
MARKS = {"gripper": (255, 0, 255), "object": (0, 255, 0)}
"""In the order of points, with the colours (RGB) that they are drawn in."""
WIDTH = 480
"""Of each of two pictures side by side, in px."""


def pixels(look: PictureLook, camera: int) -> Array:
    """Where gripper and object are in a picture (2, 2), in its px."""
    height, width = look.pictures[camera].shape[:2]
    return look.points[camera::2] * max(width, height) / 2 + [width / 2, height / 2]


def drawn(look: PictureLook, camera: int) -> Image:
    """A copy of a camera's picture with rings round what is seen, and in words what is not."""
    image = np.ascontiguousarray(look.pictures[camera]).copy()
    scale = image.shape[1] / 640
    missing = []
    points, visible = pixels(look, camera), look.visible[camera::2]
    for (mark, colour), point, seen, below in zip(MARKS.items(), points, visible, (-20, 30), strict=True):
        if not seen:
            missing.append(mark)
            continue
        x, y = (round(float(each)) for each in point)
        for ink, thickness in (((0, 0, 0), 4), (colour, 2)):
            cv2.circle(image, (x, y), round(14 * scale), ink, thickness, cv2.LINE_AA)
            cv2.circle(image, (x, y), 1, ink, thickness, cv2.LINE_AA)
        write(image, mark, (x, y + round(below * scale)), colour, scale)
    for row, mark in enumerate(missing, start=1):
        write(image, f"{mark}: not seen", (8, round(22 * row * scale)), (255, 60, 60), scale)
    return image


def side_by_side(look: PictureLook) -> Image:
    """Both pictures, drawn: the left camera's on the left (h, 2 × WIDTH, 3)."""
    both = [drawn(look, camera) for camera in range(2)]
    height = max(round(WIDTH * image.shape[0] / image.shape[1]) for image in both)
    return np.hstack([cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA) for image in both])


def write(image: Image, text: str, at: tuple[int, int], colour: tuple[int, ...], scale: float = 1.0) -> None:
    """Writes a line on black into an image; its foot begins at `at` (x, y)."""
    face, size = cv2.FONT_HERSHEY_SIMPLEX, 0.5 * scale
    (width, height), below = cv2.getTextSize(text, face, size, 1)
    x, y = at
    cv2.rectangle(image, (x - 2, y - height - 2), (x + width + 2, y + below), (0, 0, 0), cv2.FILLED)
    cv2.putText(image, text, at, face, size, colour, 1, cv2.LINE_AA)


def jpeg(image: Image) -> bytes:
    """An RGB image as a file."""
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
