"""What the environment needs to know of an arm: its names, its ranges, where things are, and its scene."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, wraps
from typing import Any, NamedTuple, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import near_misses
from calfree_gym.geometry import Array, Flags, in_frame
from calfree_gym.image import CAMERAS

Places = NDArray[np.int64]
Furnish = Callable[[Any], None]
"""Changes an `mujoco.MjSpec`, whose type is not declared."""
Mounts = tuple[str, str]
"""Names of the bodies to which the left and the right camera are fixed; "world" is the room."""


HINGE_SPEED, SLIDE_SPEED = 0.7, 0.25
"""Assumed speed of the joint that takes longest, in rad/s or m/s, for robot time."""
ROOM = "world"
"""Name of the body that stands for the room."""


class Rig(NamedTuple):
    """Where the built robot's cameras are, in the room, with the arm at home.

    Attributes:
        position: Optical centres (2, 3) in m, left and right.
        target: What they look at (3,) in m.
        scale: How large all that is, relative to the RV-M2's.
    """

    position: Array
    target: Array
    scale: float


class Robot(ABC):
    """An arm, as the environment sees it. Registers and control words have m numbers, one a motor.

    Attributes:
        cameras: Names of the cameras.
        wheels: Names of the wheels; an arm has none.
        marks: On the front of a base that docks, as built (d, 3); an arm has none.
        motors: Names of the motors.
        joints: Names of the joints that have a zero, k of them; the motors' come first.
        links: Names of the links, l of them.
        lengths: Of the links (l,) in m, as built.
        slides: Which motors (m,) slide.
        home: Positions of the motors' joints at registers zero (m,), in rad or m.
        home_qpos: Of all joints of the model at home as built (nq,).
        span: How far each goes (m,) from home to register 1, as built.
        stops: Lowest and highest position (m, 2).
        stop_margin: A motor stops this far (m,) before its joint does.
        lowest, highest: Between these positions (m,) the gripper reaches every candidate object.
        rig: Where the cameras are.
        candidates: How many drawn postures decide whether a world is in view.
        speeds: Assumed, of all joints (j,), in rad/s or m/s: for robot time.
    """

    cameras: tuple[str, ...] = CAMERAS
    wheels: tuple[str, ...] = ()
    marks: Array = np.zeros((0, 3))
    motors: tuple[str, ...]
    joints: tuple[str, ...]
    links: tuple[str, ...]
    lengths: Array
    slides: Flags
    home: Array
    home_qpos: Array
    span: Array
    stops: Array
    stop_margin: Array
    lowest: Array
    highest: Array
    rig: Rig
    candidates: int
    speeds: Array

    @property
    @abstractmethod
    def built_home(self) -> Array:
        """All joint positions (j,) at home as built."""

    @property
    @abstractmethod
    def bodies(self) -> list[str]:
        """Names of the bodies to which a camera can be fixed, the one that the first motor moves first."""

    def mounts(self, camera_mount: str | Sequence[str]) -> Mounts:
        """The bodies that "waist", "stand", a body's name, or a pair of these stands for.

        Raises:
            ValueError: There is no such body; names those that exist.
        """
        given = tuple(camera_mount) if isinstance(camera_mount, list | tuple) else (camera_mount,) * 2
        named = {"waist": self.bodies[0], "stand": ROOM}
        allowed = [*dict.fromkeys([*named, *self.bodies])]
        if len(given) != 2 or not all(mount in allowed for mount in given):
            hint = near_misses(camera_mount, allowed) if isinstance(camera_mount, str) else ""
            raise ValueError(
                f"camera_mount is {camera_mount!r}{hint}; allowed: {', '.join(allowed)}, or a pair of these"
            )
        left, right = (named.get(mount, mount) for mount in given)
        return left, right

    def mount_name(self, mounts: Mounts) -> str:
        """What errors call a mount, such as "the 'waist' mount"."""
        names = {self.bodies[0]: "waist", ROOM: "stand"}
        return f"the {' and '.join(repr(names.get(each, each)) for each in dict.fromkeys(mounts))} mount"

    def postures(self, shares: Array) -> Array:
        """Positions of the motors' joints (..., m), in shares (..., m) of the way from lowest to highest."""
        return self.lowest + shares * (self.highest - self.lowest)

    @abstractmethod
    def rest(self, zeros: Array) -> Array:
        """What `angles` must know of a world with these joint zeros (k,)."""

    @abstractmethod
    def angles(self, positions: Array, rest: Array) -> Array:
        """All joint positions (..., j) where the motors' joints are at `positions` (..., m)."""

    @abstractmethod
    def gripper_position(self, angles: Array, lengths: Array) -> Array:
        """Gripper points (..., 3) in m, in the room, at joint positions (..., j) and lengths (..., l)."""

    @abstractmethod
    def within(self, points: Array) -> Flags:
        """Which points (..., 3) lie where objects are placed."""

    @abstractmethod
    def frames(self, body: str, angles: Array, lengths: Array) -> tuple[Array, Array]:
        """Position (..., 3) in m and axes as columns (..., 3, 3) of a body, in the room."""

    def home_frame(self, body: str) -> tuple[Array, Array]:
        """The same (3,) and (3, 3), at home as built."""
        if body not in self._home_frames:
            self._home_frames[body] = self.frames(body, self.built_home, self.lengths)
        return self._home_frames[body]

    @cached_property
    def _home_frames(self) -> dict[str, tuple[Array, Array]]:
        """Those that were asked for, and the room's."""
        return {ROOM: (np.zeros(3), np.eye(3))}

    def room_moved_with(self, body: str, angles: Array, lengths: Array) -> tuple[Array, Array]:
        """Origin (..., 3) and axes as columns (..., 3, 3) of the room, had it moved with a body."""
        (position, axes), (home, home_axes) = self.frames(body, angles, lengths), self.home_frame(body)
        turned = axes @ home_axes.T
        return position - turned @ home, turned

    def into_mounts(self, points: Array, angles: Array, lengths: Array, mounts: Mounts) -> Array:
        """Points (..., 3) of the room as the cameras on `mounts` have them before them (..., 1 or 2, 3).

        That is where they would be, had the room moved instead of the cameras since home as built. One for
        both cameras, where both are fixed to one body.
        """
        moved, shape = [], np.broadcast_shapes(points.shape[:-1], angles.shape[:-1])
        for body in dict.fromkeys(mounts):
            if body == ROOM:
                moved.append(np.broadcast_to(points, (*shape, 3)))
                continue
            moved.append(in_frame(points, *self.room_moved_with(body, angles, lengths)))
        return np.stack(moved, -2)

    @abstractmethod
    def scene(self, mounts: Mounts, furnish: Furnish | None = None) -> Scene:
        """The simulated scene, with cameras, object and points.

        Args:
            mounts: Where the cameras are fixed.
            furnish: Changes the spec of the bare arm, before anything of ours is added.
        """

    @abstractmethod
    def stretch(self, body_positions: Array, lengths: Array) -> None:
        """Writes the offsets of all bodies (nbody, 3) at these lengths of links (l,)."""


Told = TypeVar("Told")


def kept_with_robot(tell: Callable[[Robot], Told]) -> Callable[[Robot], Told]:
    """Keeps what a function tells of a robot as long as that robot, which may hold hundreds of megabytes."""

    @wraps(tell)
    def told(robot: Robot) -> Told:
        kept: dict[Callable[[Robot], Told], Told] = vars(robot).setdefault("kept", {})
        if tell not in kept:
            kept[tell] = tell(robot)
        return kept[tell]

    return told


class Scene(NamedTuple):
    """A compiled model, and where in it the environment's things are.

    Attributes:
        model: The model.
        stepped: What physics steps: of an arm that touches nothing, the same without shapes and lights.
        home: Of all joints (nq,).
        ctrl: Of all actuators (nu,), at home.
        act: Of all states of actuators (na,), at home.
        qpos: Of the joints of `Robot.angles`, where they stand in qpos (j,).
        actuators: Their servos (j,).
        sensors: Place of the first of 20 numbers among the sensors: image points, then depths.
        prefix: Of the names of all that was added: cameras, their rods, lamp, marks and points.
        covers: Names of the textures that cover table and room.
    """

    model: mujoco.MjModel
    stepped: mujoco.MjModel
    home: Array
    ctrl: Array
    act: Array
    qpos: Places
    actuators: Places
    sensors: int
    prefix: str
    covers: tuple[str, ...]
