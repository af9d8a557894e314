"""A mobile base: its wheels, its cameras, and the marks on its front that are to meet those of a dock.

Poses (x, y, heading) are in m and rad. A base's frame has its origin on the floor between the wheels, x
ahead, y to the left, z up. Docked, it is the dock's frame, too.
"""

from __future__ import annotations

import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import CAMERAS
from calfree_gym.robot.arms.robot import Mounts, Rig

WHEEL_RADIUS, TRACK = 0.08, 0.35
"""In m. Choice: as of robots for rooms. The track is the diameter on which the wheels stand."""
ROLL = 1.0
"""How far a wheel rolls at a word of 1 (m), as built."""
SPEED = 0.5
"""Assumed speed of a wheel's rim (m/s), for robot time."""
MARKS = np.array([[0.55, -0.15, 0.25], [0.55, 0.15, 0.25], [0.9, -0.3, 0.7], [0.9, 0.3, 0.7]])
"""On the front, as built (4, 3): two 0.45 m and two 0.8 m ahead of the camera. Choice: the docked pose is
seen to 2 cm and 2 degrees by marks at different depths alone (see `Berths.accuracy`)."""
_EYES = {1: [[0.1, 0.0, 0.5]], 2: [[0.1, 0.1, 0.5], [0.1, -0.1, 0.5]]}
_WHEELS = {"differential": ("left", "right"), "omni": ("left", "right", "rear")}
_OMNI = np.radians([60.0, -60.0, 180.0])
"""Where the wheels of an omnidirectional base stand, from ahead to the left; each rolls along the rim."""
BASES = tuple(_WHEELS)
MOST_CAMERAS = max(_EYES)


class Base:
    """A base on two wheels and casters, or on three omnidirectional wheels. As a `Robot`, it has no joints.

    Attributes:
        kind: "differential" or "omni".
        cameras: Names of the cameras: "front", or "left" and "right".
        motors, wheels: Names of the motors, one a wheel.
        joints: None has a zero.
        links: "track" is the one length.
        marks: On its front as built (d, 3).
        stand: Where the wheels stand (m, 2), ahead and to the left, in halves of the track.
        rolls: Where to they roll the base (m, 2), likewise, of unit length.

    Args:
        kind: See above.
        cameras: 1 or 2.
        marks: How many, from 2 to 4: the near ones first.
    """

    joints: tuple[str, ...] = ()
    links = ("track",)
    bodies = ("base",)

    def __init__(self, kind: str, cameras: int, marks: int) -> None:
        self.kind = kind
        self.cameras = CAMERAS if cameras == 2 else ("front",)
        self.motors = self.wheels = _WHEELS[kind]
        self.lengths = np.array([TRACK])
        self.slides = np.zeros(len(self.motors), bool)
        self.span = np.full(len(self.motors), ROLL / WHEEL_RADIUS)
        self.marks = MARKS[:marks]
        self.rig = Rig(np.array(_EYES[cameras]), np.array([1.1, 0.0, 0.35]), 1.0)
        if kind == "omni":
            self.stand = np.stack([np.cos(_OMNI), np.sin(_OMNI)], -1)
            self.rolls = self.stand[:, ::-1] * [-1, 1]
            self._rolling = np.column_stack([self.rolls, np.ones(3)]) * 2 / 3
        else:
            self.stand, self.rolls = np.array([[0.0, 1.0], [0.0, -1.0]]), np.array([[1.0, 0.0], [1.0, 0.0]])
            self._rolling = np.array([[0.5, 0.0, -1.0], [0.5, 0.0, 1.0]])

    def mounts(self, camera_mount: object) -> Mounts:
        """The one body that there is."""
        return self.bodies[0], self.bodies[0]

    def mount_name(self, mounts: Mounts) -> str:
        """What errors call it."""
        return f"the {self.kind} base"

    def arc(self, ways: Array, track: Array) -> Array:
        """How far a base comes ahead, to the left and about (n, 3), if it went straight on, then turned.

        All wheels take the same time, in a constant ratio: the base follows an arc.

        Args:
            ways: How far the wheels roll (n, m) in m.
            track: Its track (n,) in m.
        """
        arc = np.zeros((len(ways), 3))
        for way, of_wheel in zip(ways.T, self._rolling, strict=True):  # matrix products differ in last bits
            arc += way[:, None] * of_wheel
        arc[:, 2] /= track
        return arc


def along(poses: Array, arcs: Array) -> Array:
    """Poses (n, 3) to which arcs (n, 3) lead, in closed form: the exponential map of the plane's motions."""
    ahead, left, turn = arcs.T
    chord = np.sinc(turn / (2 * np.pi))
    heading = poses[:, 2] + turn / 2
    cosine, sine = chord * np.cos(heading), chord * np.sin(heading)
    x, y = poses[:, 0] + cosine * ahead - sine * left, poses[:, 1] + sine * ahead + cosine * left
    return np.stack([x, y, poses[:, 2] + turn], -1)


def arc_to(pose: Array) -> Array:
    """The arc (3,) that leads from the origin to a pose (3,): the inverse of `along`."""
    chord, half = np.sinc(pose[2] / (2 * np.pi)), pose[2] / 2
    cosine, sine = np.cos(half) / chord, np.sin(half) / chord
    return np.array([cosine * pose[0] + sine * pose[1], cosine * pose[1] - sine * pose[0], pose[2]])


def placed(frame: Array, poses: Array) -> Array:
    """Poses (..., 3) that are relative to frames (..., 3), as the frames themselves are given."""
    cosine, sine = np.cos(frame[..., 2]), np.sin(frame[..., 2])
    x, y = poses[..., 0], poses[..., 1]
    return np.stack(
        [
            frame[..., 0] + cosine * x - sine * y,
            frame[..., 1] + sine * x + cosine * y,
            frame[..., 2] + poses[..., 2],
        ],
        -1,
    )


def relative(frame: Array, poses: Array) -> Array:
    """Poses (..., 3) relative to frames (..., 3); headings within +-pi."""
    cosine, sine = np.cos(frame[..., 2]), np.sin(frame[..., 2])
    x, y = poses[..., 0] - frame[..., 0], poses[..., 1] - frame[..., 1]
    heading = poses[..., 2] - frame[..., 2]
    heading = heading - 2 * np.pi * np.round(heading / (2 * np.pi))
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, heading], -1)


def before(poses: Array, points: Array) -> Array:
    """Points (..., d, 3) of the room as bases at poses (..., 3) have them in their frames (..., d, 3)."""
    cosine, sine = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x, y = points[..., 0] - poses[..., 0, None], points[..., 1] - poses[..., 1, None]
    z = np.broadcast_to(points[..., 2], x.shape)
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], -1)
