"""Which pictures are newer than a motion: LeRobot gives no time stamps, but a new frame is a new object."""

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

    Args:
        cameras: Their names.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        self.cameras = tuple(cameras)
        self.pictures: dict[str, Array] = {}
        self._frames: dict[str, Any] = {}
        self._since: dict[str, float] = {}

    def note(self, now: float, observation: dict[str, Any]) -> None:
        """Takes in what was observed at a time, in s.

        Raises:
            ArmError: A camera has frozen; names it.
        """
        for name in self.cameras:
            if observation[name] is not self._frames.get(name):
                self._frames[name], self._since[name] = observation[name], now
            elif now - self._since[name] > FROZEN_S:
                raise _frozen(name)

    def newer_than(self, moment: float, now: float) -> tuple[Array, ...] | None:
        """Both pictures (h, w, 3), where all that they show is later than a moment; else None.

        A frame that is the last picture again, to the byte, is no new one: a live camera has noise.

        Raises:
            ArmError: They ought to have come; names the camera that has frozen.
        """
        if min(self._since.values()) <= moment + LATENCY_S:
            return None
        pictures = {name: np.asarray(frame) for name, frame in self._frames.items()}
        copies = [name for name, each in pictures.items() if np.array_equal(each, self.pictures.get(name))]
        if copies:
            if now - moment > LATENCY_S + FROZEN_S:
                raise _frozen(copies[0])
            return None
        self.pictures = pictures
        return tuple(pictures.values())


def _frozen(name: str) -> ArmError:
    return ArmError(
        f"camera {name} has shown no new picture for {FROZEN_S:g} s: it is frozen, or sees nothing"
    )
