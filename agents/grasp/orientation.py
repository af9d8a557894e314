"""By what angle the jaws must turn: by the object's axis and the gripper's directions in images (3.5)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.observation import Array
from .observation import OBJECT, GraspObservation

UPRIGHT = 1.0
"""An axis that lies along the gripper's by more than this, relative to what lies across, needs no turn.
Choice: 45 degrees."""


def turn_needed(kind: str, now: GraspObservation) -> float | None:
    """By what angle (rad) the jaws' edges must turn about the gripper's axis to lie along the object's.

    Args:
        kind: One of `ORIENTATION`.
        now: What is seen.

    Returns:
        It, within a quarter turn, or None where the object is round or its axis is the gripper's, and any
        turn will do, and where too little is seen.
    """
    lengths = now.in_gripper_lengths(now.between("end_2", "end_1"))
    needed = now.visible[OBJECT:] if kind == "least_squares" else now.visible
    if lengths is None or not needed.all():
        return None
    edge, line, along = lengths
    if abs(along) >= UPRIGHT * np.hypot(edge, line):
        return None
    return ORIENTATION[kind](now, lengths)


def directions(now: GraspObservation) -> Array:
    """The angle in each image (2,) between the jaws' edges and the object's axis, in rad, as lines have them.

    0 where the object is round: any turn will do.
    """
    edge, axis = now.between("edge_2", "edge_1"), now.between("end_2", "end_1")
    if not axis.any():
        return np.zeros(2)
    return np.array([_between_lines(edge[i : i + 2], axis[i : i + 2]) for i in (0, 2)])


def direction_key(now: GraspObservation) -> Array:
    """Both directions as coordinates of knowledge (2,): their mean, and half their difference (section 4.3).

    In quarter turns. A line's angle jumps by half a turn where it passes a quarter turn, and in each image
    that is at another orientation of the object. These two jump only where the turn that is needed jumps.
    """
    left, right = directions(now)
    return np.array([_mean(left, right), quarter(left - right) / 2]) / (np.pi / 2)


def by_one_image(now: GraspObservation, _: Array) -> float:
    """The angle in the left image between the jaws' edges and the object's axis."""
    return float(directions(now)[0])


def by_both_images(now: GraspObservation, _: Array) -> float:
    """The mean of that in both images (Nguyen 1997): right at zero; elsewhere perspective bends it."""
    return _mean(*directions(now))


def by_least_squares(_: GraspObservation, lengths: Array) -> float:
    """The angle between edge and axis in the world, by the object's axis in gripper lengths (3,)."""
    return quarter(float(np.arctan2(lengths[1], lengths[0])))


ORIENTATION: dict[str, Callable[[GraspObservation, Array], float]] = {
    "least_squares": by_least_squares,
    "both_images": by_both_images,
    "one_image": by_one_image,
}


def _between_lines(first: Array, second: Array) -> float:
    """From the first of two directions (2,) to the second, as lines (rad)."""
    cross = first[0] * second[1] - first[1] * second[0]
    return quarter(float(np.arctan2(cross, first @ second)))


def _mean(first: float, second: float) -> float:
    """The mean of two lines' angles (rad): of 80 and -80 degrees it is 90."""
    return quarter(first + quarter(second - first) / 2)


def quarter(angle: float) -> float:
    """An angle between lines, within a quarter turn."""
    return (angle + np.pi / 2) % np.pi - np.pi / 2
