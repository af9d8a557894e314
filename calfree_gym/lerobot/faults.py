"""What can go wrong with a real arm, in words, and the pictures of it."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calfree_gym.picture_reach import Array

PATIENCE = 3
"""So many motions in a row a fault is tolerated with which agents can live. Choice."""


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


class Tolerated:
    """Counts for how many motions in a row each of some faults lasts."""

    def __init__(self) -> None:
        self._lasts: dict[str, int] = {}

    def count(self, faults: Mapping[str, str], moved: bool) -> None:
        """Takes in what is wrong after a motion, in words, by what it is; a look makes no fault older."""
        self._lasts = {fault: self._lasts.get(fault, 0) + moved for fault in faults}

    @property
    def lasting(self) -> tuple[str, ...]:
        """What has lasted for too long."""
        return tuple(fault for fault, lasts in self._lasts.items() if lasts >= PATIENCE)


class SeenPlaces:
    """Where a mark was seen in a trial. What is not seen there any more is hidden by no part of the arm."""

    SAME = 0.002
    """Registers that differ by less are the same place. Choice: a tick of 4096 where a unit is 45 degrees."""

    def __init__(self) -> None:
        self._seen: dict[str, list[Array]] = {}

    def note(self, mark: str, registers: Array) -> None:
        """A mark is seen where motors stand at registers (m,)."""
        self._seen.setdefault(mark, []).append(registers)

    def hold(self, mark: str, registers: Array) -> bool:
        """Whether the mark was seen where motors stand at registers (m,)."""
        return any(np.abs(registers - place).max() < self.SAME for place in self._seen.get(mark, []))
