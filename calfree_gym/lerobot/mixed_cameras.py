"""Tells where a picture is of the other camera: names of USB cameras may change places."""

from collections.abc import Mapping

import cv2
import numpy as np

from calfree_gym.picture_reach import Array

SMALL = (32, 24)
"""Width and height of pictures that are compared. Choice: an arm that moves changes few of their pixels."""
MUCH_MORE = 0.5
"""A picture is of the other camera where it differs from the other's last one by less than this share of what
it differs from its own: squares. Choice: a knocked camera's differs from both."""


class MixedCameras:
    """Remembers of two cameras what each has shown last."""

    def __init__(self) -> None:
        self._last: dict[str, Array] = {}

    def __call__(self, pictures: Mapping[str, Array]) -> tuple[bool, ...]:
        """Which pictures (h, w, 3), by their cameras' names, are like the other's and unlike their own."""
        small = {name: _small(picture) for name, picture in pictures.items()}
        mixed = {name: self._is_other(name, each) for name, each in small.items()}
        self._last |= {name: each for name, each in small.items() if not mixed[name]}
        return tuple(mixed.values())

    def _is_other(self, name: str, small: Array) -> bool:
        if len(self._last) < 2:
            return False
        (other,) = (last for camera, last in self._last.items() if camera != name)
        own = self._last[name]
        return bool(np.square(small - other).sum() < MUCH_MORE * np.square(small - own).sum())


def _small(picture: Array) -> Array:
    """A small grey copy, of whatever brightness and contrast."""
    grey = cv2.resize(picture, SMALL, interpolation=cv2.INTER_AREA).astype(float).mean(-1)
    return (grey - grey.mean()) / max(float(grey.std()), 1.0)
