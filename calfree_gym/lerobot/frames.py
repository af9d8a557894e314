"""Which pictures are newer than a motion: LeRobot gives no time stamps, but a new frame is a new object."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from calfree_gym.lerobot.faults import ArmError
from calfree_gym.picture_reach import Array

LATENCY_S = 0.2
"""What comes later than that after a moment was exposed after it. Choice: a webcam's pipeline holds two to
four frames."""
FROZEN_S = 1.0
"""A camera has frozen that shows nothing new for so long. Choice: LeRobot complains after half of it."""


class Frames:
    """The latest frames of two cameras, and since when each is there.

    Attributes:
        pictures: What was looked at last, by the names of cameras.

    Args:
        cameras: Their names.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        self.cameras = tuple(cameras)
        self.pictures: dict[str, Array] = {}
        self._frames: dict[str, Any] = {}
        self._since: dict[str, float] = {}
        self._old: dict[str, Any] = {}
        self._settled = -math.inf

    def note(self, now: float, observation: dict[str, Any]) -> None:
        """Takes in what was observed at a time, in s.

        Raises:
            ArmError: A camera has frozen, or gives nothing; names it.
        """
        for name in self.cameras:
            if observation.get(name) is None:
                raise ArmError(f"camera {name} has given no picture")
            if observation[name] is not self._frames.get(name):
                self._frames[name], self._since[name] = observation[name], now
            elif now - self._since[name] > FROZEN_S:
                raise _frozen(name)

    def settle(self, now: float) -> None:
        """The arm stands still from now on: what is to be looked at must be newer."""
        self._settled, self._old = now, dict(self._frames)

    def newer(self, now: float) -> tuple[Array, ...] | None:
        """Both pictures (h, w, 3), where all that they show is later than the arm has settled; else None.

        A frame that is the old one again, to the byte, is no new one: a live camera has noise.

        Raises:
            ArmError: They ought to have come; names the camera that has frozen.
        """
        if min(self._since.values()) <= self._settled + LATENCY_S:
            return None
        pictures = {name: np.asarray(frame) for name, frame in self._frames.items()}
        copies = [name for name, each in pictures.items() if np.array_equal(each, self._old[name])]
        if not copies:
            self.pictures = pictures
            return tuple(pictures.values())
        if now - self._settled > LATENCY_S + FROZEN_S:
            raise _frozen(copies[0])
        return None


def _frozen(name: str) -> ArmError:
    return ArmError(
        f"camera {name} has shown no new picture for {FROZEN_S:g} s: it is frozen, or sees nothing"
    )
