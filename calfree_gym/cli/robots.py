"""Robots: made of LeRobot's own flags, and never left without somebody who supports them."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, suppress
from dataclasses import make_dataclass
from importlib import import_module
from io import StringIO
from typing import Any

from calfree_gym.lerobot.robot import LeRobot
from calfree_gym.lerobot.torque import Torque

INSTALL = "pip install 'lerobot[feetech]>=0.6,<0.7', with Python 3.12 or later"
FLAG = "--robot."
Ask = Callable[[str], Any]
"""Says something, and waits until somebody has done it."""


def lerobot_robot(flags: Sequence[str]) -> LeRobot:
    """The robot that flags such as `--robot.type=so101_follower` describe; not connected.

    Raises:
        ImportError: LeRobot is not installed, or lacks what this robot needs.
        ValueError: LeRobot does not take these flags.
    """
    try:
        import draccus
        from lerobot.robots import RobotConfig, make_robot_from_config
        from lerobot.utils.import_utils import register_third_party_plugins
    except ImportError as error:
        raise ImportError(f"LeRobot is needed to drive an arm ({error}): {INSTALL}") from error
    _register("lerobot.robots")
    _register("lerobot.cameras")
    register_third_party_plugins()
    Flags = make_dataclass("Flags", [("robot", RobotConfig)])
    said = StringIO()
    try:
        with redirect_stderr(said):
            config = draccus.parse(Flags, args=list(flags)).robot
    except (SystemExit, Exception) as error:  # it parses by argparse, which ends the process
        why = said.getvalue().rpartition("error: ")[2].strip() or error.__cause__ or error
        what = (
            f"does not take {' '.join(flags)}" if flags else f"needs flags, such as {FLAG}type=so101_follower"
        )
        raise ValueError(f"LeRobot {what}: {why}") from error
    return make_robot_from_config(config)


def _register(package: str) -> None:
    """Has LeRobot know all its types: each is known once its module is loaded."""
    for module in pkgutil.iter_modules(import_module(package).__path__, f"{package}."):
        if module.ispkg:
            with suppress(ImportError):  # what needs more than is installed
                import_module(module.name)


@contextmanager
def connecting() -> Iterator[None]:
    """Makes whatever LeRobot raises as a robot is connected an error that says so."""
    try:
        yield
    except (ImportError, OSError, ValueError):
        raise
    except Exception as error:
        raise ConnectionError(f"the robot cannot be connected: {error}") from error


@contextmanager
def supported(robot: LeRobot, ask: Ask) -> Iterator[None]:
    """Afterwards the arm holds, until somebody says that she supports it."""
    torque = Torque(robot)
    try:
        yield
    finally:
        if robot.is_connected:
            _release(torque, ask)


def _release(torque: Torque, ask: Ask) -> None:
    print("The arm holds; Ctrl-C leaves it so.")
    try:
        torque.release(ask)
    except (EOFError, KeyboardInterrupt):
        print("\nThe arm goes on to hold. To release it, support it, and switch the motors' power off.")
    except Exception as error:
        print(f"The robot does not answer ({error}). Support the arm, and switch the motors' power off.")
