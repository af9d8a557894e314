"""By what angle the jaws must turn: by the object's axis and the gripper's directions in images (3.5)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.observation import Array
from .observation import GraspObservation

UPRIGHT = 1.0
"""An axis that lies along the gripper's by more than this, relative to what lies across, needs no turn.
Choice: 45 degrees."""


WORLD = np.array([1.0, 1.1, 1.0])
"""How long the line of the open jaws and the gripper's axis are, relative to its edge: roughly, for where the
angle is zero they do not matter."""


def turn_needed(kind: str, now: GraspObservation) -> float | None:
    """By what angle (rad) the jaws' edges must turn about the gripper's axis to lie along the object's.

    Args:
        kind: One of `ORIENTATION`.
        now: What is seen.

    Returns:
        It, within a quarter turn, or None where the object's axis is the gripper's, and any turn will do.
    """
    edge, line, along = _in_directions_of_the_gripper(now)
    if abs(along) > UPRIGHT * np.hypot(edge, line):
        return None
    return ORIENTATION[kind](now)


def by_one_image(now: GraspObservation) -> float:
    """The angle in the left image between the jaws' edges and the object's axis."""
    return _between_lines(now.between("edge_2", "edge_1")[:2], now.between("end_2", "end_1")[:2])


def by_both_images(now: GraspObservation) -> float:
    """The mean of that in both images (Nguyen 1997): right at zero; elsewhere perspective bends it."""
    edge, axis = now.between("edge_2", "edge_1"), now.between("end_2", "end_1")
    return float(np.mean([_between_lines(edge[i : i + 2], axis[i : i + 2]) for i in (0, 2)]))


def by_least_squares(now: GraspObservation) -> float:
    """The angle between edge and axis in the world, as far as both images tell.

    The object's axis is made up of three directions that are seen on the gripper. So neither the cameras nor
    perspective matter near the gripper.
    """
    edge, line, _ = _in_directions_of_the_gripper(now)
    return quarter(float(np.arctan2(line, edge)))


ORIENTATION: dict[str, Callable[[GraspObservation], float]] = {
    "least_squares": by_least_squares,
    "both_images": by_both_images,
    "one_image": by_one_image,
}


def _in_directions_of_the_gripper(now: GraspObservation) -> Array:
    """The object's axis (3,) along the gripper's edge, the line of its jaws, and its axis: by both images."""
    directions = [now.between("edge_2", "edge_1"), now.between("jaw_2", "jaw_1"), now.between("tip", "base")]
    return WORLD * np.linalg.lstsq(np.stack(directions, 1), now.between("end_2", "end_1"), rcond=None)[0]


def _between_lines(first: Array, second: Array) -> float:
    """From the first of two directions (2,) to the second, as lines (rad)."""
    cross = first[0] * second[1] - first[1] * second[0]
    return quarter(float(np.arctan2(cross, first @ second)))


def quarter(angle: float) -> float:
    """An angle between lines, within a quarter turn."""
    return (angle + np.pi / 2) % np.pi - np.pi / 2
