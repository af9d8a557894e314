"""What is asked of a robot before anything moves, and what is known of its motors' encoders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.picture_reach import Array

POSITION = ".pos"
"""How the keys of positions end."""
FEWEST = 3
"""Motors that reaching needs, for the object may be anywhere in space."""
SAG = 3.0
"""Degrees that a motor sinks below its goal. Measured: an STS3215 under load."""
HALF_TURN = 180.0
"""In degrees."""
DEGREES = "degrees"
"""What LeRobot calls the unit of motors that go by degrees."""
FULL_TURN = 4095
"""Ticks that LeRobot takes for 360 degrees, of motors that tell no other number."""


class LeRobot(Protocol):
    """What is used of LeRobot's `Robot`; besides, where it is there, `config`, `bus`, `clock` and `sleep`."""

    @property
    def action_features(self) -> dict[str, Any]:
        """What `send_action` takes."""

    @property
    def observation_features(self) -> dict[str, Any]:
        """What `get_observation` gives."""

    @property
    def is_connected(self) -> bool:
        """Whether motors and cameras answer."""

    def connect(self, calibrate: bool = True) -> None:
        """Opens bus and cameras; motors are without torque for a moment."""

    def disconnect(self) -> None:
        """Closes them."""

    def get_observation(self) -> dict[str, Any]:
        """Where motors stand, and the latest pictures."""

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Tells motors where to go."""


def checked_motors(robot: LeRobot, motors: Sequence[str] | None) -> tuple[str, ...]:
    """The names of the motors that are to move; by default all but a gripper's.

    Raises:
        ValueError: The robot has no such motors, they are fewer than three, or it takes other actions than
            positions; names them.
    """
    actions = tuple(robot.action_features)
    if others := [key for key in actions if not key.endswith(POSITION)]:
        name = getattr(robot, "name", type(robot).__name__)
        raise ValueError(
            f"the robot {name} takes actions {', '.join(others)}; only positions (.pos) are allowed"
        )
    if getattr(getattr(robot, "config", None), "use_degrees", True) is False:
        raise ValueError(
            "the robot's config has use_degrees=False; it must be True: positions are in degrees"
        )
    there = [key.removesuffix(POSITION) for key in actions]
    chosen = [name for name in there if "gripper" not in name] if motors is None else list(motors)
    _check_names("motor", chosen, there)
    of_bus = getattr(getattr(robot, "bus", None), "motors", {})
    for name in chosen:
        mode = getattr(of_bus.get(name), "norm_mode", DEGREES)
        if (unit := getattr(mode, "value", mode)) != DEGREES:
            raise ValueError(f"motor {name} goes by {unit}; only motors that go by {DEGREES} are allowed")
    if len(chosen) < FEWEST:
        raise ValueError(
            f"the motors are {', '.join(chosen)}; reaching needs {FEWEST} or more; it has {', '.join(there)}"
        )
    return tuple(chosen)


def checked_cameras(robot: LeRobot, cameras: Sequence[str]) -> tuple[str, str]:
    """The names of the two cameras.

    Raises:
        ValueError: The robot has no such cameras, or they are not two; names those that it has.
    """
    there = [
        key for key, shape in robot.observation_features.items() if np.shape(shape) == (3,) and shape[2] == 3
    ]
    found = [cameras] if isinstance(cameras, str) else list(cameras)
    _check_names("camera", found, there)
    if len(found) != 2:
        raise ValueError(f"cameras is {cameras!r}; it must be the names of two of {', '.join(there)}")
    return found[0], found[1]


def _check_names(what: str, names: Sequence[str], there: Sequence[str]) -> None:
    has = f"it has {', '.join(there) or 'none'}"
    for name in names:
        if name not in there:
            raise ValueError(f"the robot has no {what} {name!r}{near_misses(name, there)}; {has}")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"the {what}s are {', '.join(names) or 'none'}; each must be named once; {has}")


def check_most_ahead(robot: LeRobot, ahead: float) -> None:
    """Raises ValueError where the robot clips goals that are `ahead` of where it stands, in degrees."""
    most = getattr(getattr(robot, "config", None), "max_relative_target", None)
    for value in most.values() if isinstance(most, dict) else [most]:
        if value is not None and (not isinstance(value, float) or value < ahead):
            raise ValueError(
                f"the robot's config has max_relative_target={most!r}; it must be None, or {ahead:.1f} or "
                "more, as a float: an int raises TypeError in LeRobot. The environment limits steps by itself"
            )


@dataclass(frozen=True)
class Encoder:
    """How the positions of a motor, in degrees, follow from its ticks.

    Attributes:
        middle: Ticks of 0 degrees.
        turn: Ticks of 360 degrees, as LeRobot has them: one fewer than the encoder tells.
        offset: Ticks that the motor takes from what its encoder says.
        low, high: Ticks that it cannot pass.
    """

    middle: float
    turn: float
    offset: int
    low: int
    high: int

    def ticks(self, degrees: float) -> float:
        """What the motor says where it stands at so many degrees."""
        return degrees * self.turn / 360 + self.middle

    def says(self, encoder: float) -> float:
        """What it says, within a turn, where its encoder says so many ticks, a turn off at most."""
        ticks, turn = encoder - self.offset, self.turn + 1
        return ticks % turn if -turn <= ticks < 2 * turn else ticks

    def degrees(self, ticks: float) -> float:
        """Where it stands, in degrees, where it says so many ticks."""
        return (ticks - self.middle) * 360 / self.turn


def read_encoders(robot: LeRobot, motors: Sequence[str]) -> dict[str, Encoder]:
    """The encoders of these motors; none where the robot has no bus of its own that counts in ticks.

    Offsets and limits are read that the motors have, and LeRobot goes by them, whatever a file of
    calibrations says: it may be of another day. Dynamixel's motors add their offsets, others take them.
    """
    bus: Any = getattr(robot, "bus", None)
    if not hasattr(bus, "set_half_turn_homings"):
        return {}
    bus.calibration = bus.read_calibration()
    takes = -1 if any("Dynamixel" in kind.__name__ for kind in type(bus).__mro__) else 1
    encoders = {}
    for name in motors:
        known = bus.calibration[name]
        turn = FULL_TURN
        if hasattr(bus, "model_resolution_table"):
            turn = bus.model_resolution_table[bus.motors[name].model] - 1
        low, high = known.range_min, known.range_max
        encoders[name] = Encoder((low + high) / 2, turn, takes * known.homing_offset, low, high)
    return encoders


def robot_motors(robot: LeRobot) -> list[str]:
    """All motors that a robot has."""
    return [key.removesuffix(POSITION) for key in robot.action_features]


def check_limits(
    encoders: dict[str, Encoder], motors: Sequence[str], home: Array, here: Array, unit: float
) -> None:
    """Raises ValueError where motors that stand here (m,) cannot go `unit` degrees either way from home (m,).

    Says what to do. Where limits are not known, home is at most half a turn off: it never need be farther.
    """
    for name, at, now in zip(motors, home.tolist(), here.tolist(), strict=True):
        if (encoder := encoders.get(name)) is None:
            if not abs(at - now) <= HALF_TURN:
                raise ValueError(
                    f"motor {name} is at {at:g} degrees at home, and stands at {now:g}; allowed: "
                    f"{HALF_TURN:g} degrees off at most. Choose another home, or bring the motor nearer to it"
                )
            continue
        ends, sag = (encoder.ticks(at - unit), encoder.ticks(at + unit)), SAG * encoder.turn / 360
        low, high = max(encoder.low, sag), min(encoder.high, encoder.turn - sag)
        if not low <= ends[0] <= ends[1] <= high:
            raise ValueError(
                f"motor {name} is at {encoder.ticks(at):.0f} ticks at home; {unit:g} degrees either way lead "
                f"to {ends[0]:.0f} and {ends[1]:.0f}, beyond its {low:.0f} to {high:.0f}. Choose a "
                f"smaller unit, or another home; where that is no stop of the arm, but its encoder's end, "
                f"call robot.bus.set_half_turn_homings([{name!r}]) once, and begin anew"
            )
