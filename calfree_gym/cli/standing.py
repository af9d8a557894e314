"""A robot that is looked at, and does not move."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calfree_gym.cli.robots import connecting
from calfree_gym.lerobot.faults import ArmError
from calfree_gym.lerobot.motors import AHEAD
from calfree_gym.lerobot.robot import (
    POSITION,
    LeRobot,
    check_most_ahead,
    checked_cameras,
    checked_motors,
    read_encoders,
)
from calfree_gym.picture_reach import Array, PairTracker, PictureLook, tracker_of
from calfree_gym.vision import Marks


class StandingRobot:
    """A robot, connected; it is sent no goals.

    Attributes:
        motors: Names of those that are to move, m.
        cameras: Names of left and right.
        positions: Where the motors stood at the last look (m,), in degrees.

    Args:
        robot: Of LeRobot.
        cameras, motors, marks: As of `calfree_gym.lerobot.LeRobotReachEnv`.

    Raises:
        ConnectionError: The robot cannot be connected.
        ValueError: It cannot be driven, or has no such cameras or motors; before it is connected.
    """

    def __init__(
        self,
        robot: LeRobot,
        cameras: Sequence[str],
        motors: Sequence[str] | None = None,
        marks: Marks | str | Path | PairTracker | None = None,
    ) -> None:
        self.motors, self.cameras = checked_motors(robot, motors), checked_cameras(robot, cameras)
        check_most_ahead(robot, AHEAD)
        self._robot, self._tracker = robot, tracker_of(marks)
        self.sleep: Callable[[float], None] = getattr(robot, "sleep", time.sleep)
        if not robot.is_connected:
            with connecting():
                robot.connect(calibrate=False)
        self.encoders = read_encoders(robot, self.motors)
        self.positions: Array = np.zeros(len(self.motors))

    def look(self) -> PictureLook:
        """What is seen now.

        Raises:
            ArmError: The robot does not answer.
        """
        try:
            seen: dict[str, Any] = self._robot.get_observation()
            self.positions = np.array([float(seen[f"{name}{POSITION}"]) for name in self.motors])
            left, right = (np.asarray(seen[name]) for name in self.cameras)
        except Exception as error:
            raise ArmError(f"the robot says: {type(error).__name__}: {error}") from error
        return PictureLook((left, right), *self._tracker(left, right))
