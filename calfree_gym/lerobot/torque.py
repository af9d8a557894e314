"""Keeps the torque of motors on, whatever becomes of this process, until somebody supports the arm."""

import warnings
from collections.abc import Callable
from typing import Any

from calfree_gym.lerobot.faults import ArmError

ASK = "Support the arm, for its motors lose their torque now; then press Enter: "


class Torque:
    """Sees to it that LeRobot does not switch torque off: its robots do where they are disconnected.

    They are where a `with` block ends, and where Python forgets them (`Robot.__del__`), as it does at the end
    of a process. So the setting that says so is taken back at once, and not where something has gone wrong: a
    process may be killed at any time.

    Args:
        robot: Of LeRobot.
    """

    def __init__(self, robot: Any) -> None:
        self._robot = robot
        self._config: Any = getattr(robot, "config", None)
        self._known = hasattr(self._config, "disable_torque_on_disconnect")
        self._switch_off(False)
        if not self._known:
            warnings.warn(
                "the robot's config has no disable_torque_on_disconnect: its motors may lose their torque, "
                "and the arm fall, where this process ends. Support it then",
                stacklevel=4,
            )

    def release(self, confirm: Callable[[str], Any]) -> None:
        """Disconnects the robot, without torque, once it is confirmed that somebody supports the arm.

        Raises:
            ArmError: It is not connected.
        """
        if not self._robot.is_connected:
            raise ArmError("the robot is not connected: only its power switch takes the torque now")
        confirm(ASK)
        self._switch_off(True)
        try:
            self._robot.disconnect()
        finally:
            self._switch_off(False)

    def _switch_off(self, off: bool) -> None:
        if self._known:
            self._config.disable_torque_on_disconnect = off
