"""What can go wrong with a real arm, in words, and the pictures of it."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np


class ArmError(RuntimeError):
    """A real arm cannot go on. It was told to stay where it is, and its motors keep their torque.

    Attributes:
        pictures: Files of what both cameras showed last, where that helps to see what is wrong.
    """

    def __init__(self, what: str, pictures: tuple[Path, ...] = ()) -> None:
        shown = f"; the pictures are {' and '.join(map(str, pictures))}" if pictures else ""
        super().__init__(f"{what}. The arm holds{shown}")
        self.pictures = pictures


def saved(pictures: Mapping[str, Any]) -> tuple[Path, ...]:
    """Files, in a new folder, of pictures (h, w, 3), RGB, by the names of their cameras."""
    folder = Path(tempfile.mkdtemp(prefix="calfree-"))
    files = tuple(folder / f"{name}.png" for name in pictures)
    for file, picture in zip(files, pictures.values(), strict=True):
        cv2.imwrite(str(file), np.ascontiguousarray(np.asarray(picture)[..., ::-1]))
    return files
