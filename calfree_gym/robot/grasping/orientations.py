"""In which orientations jaws can hold a thing, by its geometry and by friction alone (paper, section 3.5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.robot.grasping.jaws import AXIS, BEYOND, OPENING, PAD, STROKE
from calfree_gym.robot.grasping.shapes import BOX, CYLINDER, LARGEST, SPHERE, Part, Thing

ROLLS = np.radians(np.arange(0.0, 180.0, 7.5))
"""Of the jaws about the gripper's axis, that are tried (rad)."""
ROOM = 0.002
"""Open jaws pass by a thing at this distance (m), at least."""
OF_FRICTION = 0.8
"""Of the angle of friction, so much counts. Choice: the rest is for what is not exact."""
PALM = (0.082, 0.026, 0.058)
"""What lies so far behind the gripper point, and within so much of its axis along edge and line, is where
the palm is (m), see `jaws`."""
SPACING = 0.004
"""Between sampled points of a thing (m)."""


class Way(NamedTuple):
    """A way in which the jaws hold a thing.

    Attributes:
        pitch: Of the gripper (rad).
        roll: Of the jaws about its axis (rad), from where their edge is level.
        square: How squarely the jaws press: the cosine of the angle between their line and the thing's face.
    """

    pitch: float
    roll: float
    square: float


def ways_to_hold(thing: Thing, turned: Array, pitch: float, waist: float, friction: float) -> list[Way]:
    """All rolls in which jaws at a pitch (rad), and before a waist (rad), hold a thing.

    Two flat jaws hold what they press on within the angle of friction (Nguyen 1988) once it has turned flush,
    what fits between them when open, and what leaves room for the palm.

    Args:
        thing: The thing, the gripper point at its origin.
        turned: Its rotation (3, 3).
        pitch: Of the gripper (rad).
        waist: Which way it points, about the vertical (rad).
        friction: Between jaws and thing.
    """
    level, up = np.cos(pitch), np.sin(pitch)
    axis = np.array([level * np.cos(waist), level * np.sin(waist), up])
    side = np.array([-np.sin(waist), np.cos(waist), 0.0])
    other = np.cross(axis, side)
    points, least = surface(thing) @ turned.T, np.cos(OF_FRICTION * np.arctan(friction))
    ahead = points @ axis
    found = []
    for roll in ROLLS:
        edge = np.cos(roll) * side + np.sin(roll) * other
        line = np.cross(axis, edge)
        square, flush = pressed(thing, turned.T @ line)
        if flush >= least and _fits(ahead, points @ edge, points @ line):
            found.append(Way(float(pitch), float(roll), square))
    return found


def pressed(thing: Thing, line: Array) -> tuple[float, float]:
    """How squarely jaws press that close along a line (3,), in the thing's own frame: cosines.

    On the pair of faces on which they do so best, of those that are not too far apart: first as the thing is,
    then after it has turned between the jaws until such faces lie flush, as what is loose does.
    """
    part = thing.parts[0]
    if part.kind == SPHERE:
        return 1.0, 1.0
    if part.kind == CYLINDER:
        apart, along = 2 * part.size[:2], np.array([np.hypot(line[0], line[1]), abs(line[2])])
    else:
        apart, along = 2 * part.size, np.abs(line)
    along = along[apart <= LARGEST * OPENING]
    return float(along.max(initial=0.0)), float(np.linalg.norm(along))


def _fits(ahead: Array, along: Array, across: Array) -> bool:
    """Whether open jaws and the palm have room, by sampled points (k,) along axis, edge and line."""
    between = (np.abs(along) < PAD[1] + ROOM) & (ahead < BEYOND + ROOM)
    palm = (ahead < -PALM[0]) & (np.abs(along) < PALM[1]) & (np.abs(across) < PALM[2])
    touched = between & (ahead > -AXIS) & (np.abs(across) > STROKE - ROOM)
    held = between & (np.abs(ahead + PAD[0] - BEYOND) < PAD[0])
    return bool(held.any() and not touched.any() and not palm.any())


def surface(thing: Thing) -> Array:
    """Points (k, 3) in and on a thing, in its own frame."""
    return np.concatenate([part.place + _filled(part) for part in thing.parts])


def _filled(part: Part) -> Array:
    radius, half, _ = part.size
    sides = {SPHERE: (radius, radius, radius), CYLINDER: (radius, radius, half), BOX: tuple(part.size)}
    curved = {SPHERE: 3, CYLINDER: 2, BOX: 0}[part.kind]
    ticks = [np.linspace(-side, side, max(3, int(2 * side / SPACING))) for side in sides[part.kind]]
    points = np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, 3)
    far = np.linalg.norm(points[:, :curved], axis=1, keepdims=True)
    points[:, :curved] *= radius / np.maximum(far, radius)  # what lies beyond is brought to the surface
    return points
