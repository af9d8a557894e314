"""Cameras that deliver an old image again."""

from __future__ import annotations

import warnings
import zlib

from calfree_gym.image import CAMERAS
from calfree_gym.vision.tracking.colours import Image


class FrozenCameras:
    """Tells which cameras have frozen, and warns once when one does.

    A live camera has noise. So one has frozen whose image is the last one, to the byte, although motors have
    moved; and it has until another image comes.
    """

    def __init__(self) -> None:
        self._last: list[int | None] = [None for _ in CAMERAS]
        self._frozen = [False for _ in CAMERAS]

    def __call__(self, images: tuple[Image, ...], moved: bool) -> tuple[bool, ...]:
        """Whether each camera has frozen.

        Args:
            images: One a camera.
            moved: Whether motors have moved since the last ones.
        """
        for camera, image in enumerate(images):
            last, self._last[camera] = self._last[camera], zlib.crc32(image.tobytes())
            before, again = self._frozen[camera], last == self._last[camera]
            self._frozen[camera] = again and (before or bool(moved))
            if self._frozen[camera] and not before:
                warnings.warn(
                    f"the {CAMERAS[camera]} camera has frozen: motors have moved, and its image is the last "
                    "one to the byte. Its points count as not seen until another image comes",
                    stacklevel=3,
                )
        return tuple(self._frozen)
