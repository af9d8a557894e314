"""Reaching with a robot that gives pictures and registers, and nothing else."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_positive
from calfree_gym.image import CAMERAS
from calfree_gym.reaching import SQUARE, Array, farthest_px, reaching_observation, reaching_spaces
from calfree_gym.vision import Marks, StereoTracker

Pictures = Sequence[NDArray[np.uint8]]
"""Of both cameras, left and right: RGB (h, w, 3)."""

PATIENCE = 3
"""So many motions in a row a fault is tolerated with which agents can live. Choice."""


class LostMarkError(RuntimeError):
    """A mark is not seen any more. Nothing moves until the next trial begins."""


class PairTracker(Protocol):
    """Finds gripper and object in pairs of pictures, as `calfree_gym.vision.StereoTracker` does."""

    def __call__(self, left: Any, right: Any, moved: bool = False) -> tuple[Array, NDArray[np.bool_]]:
        """Points (4, 2) and flags (4,)."""

    def reset(self) -> None:
        """Forgets what was seen."""


class PictureLook(NamedTuple):
    """What is seen after a motion.

    Attributes:
        pictures: Of both cameras.
        points: Image points (4, 2): gripper left and right, object left and right.
        visible: Which of them are seen (4,).
    """

    pictures: Pictures
    points: Array
    visible: NDArray[np.bool_]

    @property
    def px(self) -> float:
        """The image distance in the worse camera, where the longer side of an image is 512 px."""
        return farthest_px(self.points)


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

    def show(self, mark: str, registers: Array) -> bool:
        """Whether the mark should be seen at registers (m,): it was, or it was nowhere in this trial."""
        seen = self._seen.get(mark)
        return not seen or any(np.abs(registers - place).max() < self.SAME for place in seen)


class PictureReach(gym.Env[dict[str, Array], Array]):
    """Reaching, as agents know it: control words in, image points and registers out.

    A subclass brings motors to registers and takes pictures; its `reset` ends with `_first_look`.

    Attributes:
        registers: Where motors stand (m,): 0 at home, within -1 to 1.
        motions: Of this trial.
        look: What was seen last; None before.

    Args:
        motors: How many, m.
        marks: What the gripper and the object are seen by: `Marks`, a file of them, or a tracker.
        tolerance_px: Image distance of the rendezvous, where the longer side of an image is 512 px.
        max_motions: A trial is cut off after so many.
        edges: Halves (2, 2) of the width and the height of both images, in image units.
    """

    def __init__(
        self,
        motors: int,
        marks: Marks | str | Path | PairTracker | None,
        tolerance_px: float,
        max_motions: int,
        edges: Any = SQUARE,
    ) -> None:
        check_positive("tolerance_px", tolerance_px, 256)
        self.observation_space, self.action_space = reaching_spaces(motors, edges)  # type: ignore[assignment]
        self.registers, self.motions = np.zeros(motors), 0
        self.look: PictureLook | None = None
        self._tracker = tracker_of(marks)
        self._tolerance_px, self._max_motions = tolerance_px, max_motions
        self._begun, self._moved = False, False
        self._marks = self._marks_in(CAMERAS)
        self._tolerated, self._places = Tolerated(), SeenPlaces()

    @abstractmethod
    def _move(self, words: Array) -> None:
        """Makes a motion of these words (m,), and notes registers and whether motors have moved."""

    @abstractmethod
    def _pictures(self) -> Pictures:
        """What both cameras see now."""

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """One motion: control words (m,) are added to the registers.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun, or there was an error since.
            ValueError: The words are no numbers (m,).
            LostMarkError: For three motions a mark was not seen, and now not where it was seen before.
        """
        if not self._begun:
            raise gym.error.ResetNeeded("call reset first: no trial has begun, or there was an error since")
        words = np.clip(numbers("the action holds", action, len(self.registers)), -1, 1)
        self._begun = False
        self._move(words)
        self.motions += 1
        observation, reached = self._observe()
        self._check_lasting()
        self._begun = True
        reward = 0.0 if reached else -1.0
        return observation, reward, reached, self.motions >= self._max_motions, {"is_success": reached}

    def _first_look(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """What a trial begins with."""
        self.motions = 0
        self._tracker.reset()
        self._tolerated, self._places = Tolerated(), SeenPlaces()
        observation, reached = self._observe()
        self._begun = True
        return observation, {"is_success": reached}

    def _observe(self) -> tuple[dict[str, Array], bool]:
        """The observation, and whether gripper and object are seen at one place in both images."""
        self.look = look = self._seen()
        for mark, seen in zip(self._marks, look.visible, strict=True):
            if seen:
                self._places.note(mark, self.registers)
        registers = np.clip(self.registers, -1, 1)
        return reaching_observation(look.points, look.visible, registers, self._tolerance_px)

    def _seen(self) -> PictureLook:
        """Looks. A camera that shows the same picture again, though motors have moved, is frozen."""
        left, right = self._pictures()
        return PictureLook((left, right), *self._tracker(left, right, moved=self._moved))

    @staticmethod
    def _marks_in(cameras: Sequence[str]) -> list[str]:
        return [f"the {mark} in camera {camera}" for mark in ("gripper", "object") for camera in cameras]

    def _wrong(self) -> dict[str, str]:
        """What is wrong after a motion that an agent may yet put right, in words, by what it is."""
        seen = zip(self._marks, self.look.visible, strict=True) if self.look else ()
        return {mark: f"{mark} is not seen" for mark, is_seen in seen if not is_seen}

    def _check_lasting(self) -> None:
        """Raises where something has been wrong for too long; a mark, once the arm hides it no more."""
        wrong = self._wrong()
        self._tolerated.count(wrong, self._moved)
        for fault in self._tolerated.lasting:
            if fault not in self._marks or self._places.show(fault, self.registers):
                raise self._error(f"for {PATIENCE} motions {wrong[fault]}")

    def _error(self, what: str) -> RuntimeError:
        """What is raised where the arm cannot go on."""
        return LostMarkError(f"{what}; nothing moves until the next trial begins")


def tracker_of(marks: Marks | str | Path | PairTracker | None) -> PairTracker:
    """The tracker that finds these marks.

    Raises:
        OSError: They are a file that cannot be read.
        ValueError: They are none.
    """
    if isinstance(marks, str | Path):
        marks = Marks.load(marks)
    if marks is None or isinstance(marks, Marks):
        return StereoTracker(marks)
    if callable(marks) and hasattr(marks, "reset"):
        return marks
    raise ValueError(f"marks is {marks!r}; allowed: Marks, a file of them, a tracker such as StereoTracker")


def numbers(what: str, found: Any, count: int, most: float = math.inf) -> Array:
    """What was found, where it is `count` numbers of an absolute value of at most `most`.

    Raises:
        ValueError: It is not.
    """
    try:
        values = np.asarray(found)
    except ValueError:  # lists of several lengths
        values = np.array(None)
    right = values.dtype.kind in "fiu" and values.shape == (count,) and np.isfinite(values).all()
    if not right or np.abs(values).max() > most:
        within = "" if math.isinf(most) else f" within {-most:g} to {most:g}"
        raise ValueError(f"{what} {found!r:.200}; allowed: {count} finite numbers{within}")
    return values.astype(float)
