"""What turns the jaws, and how far they still must, learned from motions that are made anyway (3.5)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

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
    "unturned": lambda *_: 0.0,
}
"""By `kind`; with the last one jaws stay as they are: so it is told what turning is worth."""


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


UNKNOWN = 3.0
"""Standard deviation of a rate (rad a word) of which nothing is known. Choice: a motor's word turns its joint
by two to five."""
ANGLE, CURVED = 0.15, 0.15
"""Standard deviation of an angle as it is seen (rad), and of a turn as a share of the expected one: motors
are curved. Choice: angles are seen to 0.1 near the object, and less well in images."""
AMBIGUOUS, SURE = np.pi / 4, np.pi / 6
"""A turn that is less surely foreseen (a deviation) is not told from half a turn more; turns are made as long
as they are foreseen more surely. Derived: angles between lines differ by two or three times that at most."""
SURPRISING = 3.0
"""An angle so many deviations away from the foreseen one was seen wrongly, or the object was pushed; two in a
row tell that motors may have changed. Derived: 0.3 %."""
AGED = 0.1
"""Of what is unknown at first, so much (a deviation) is unknown again in the next trial. Choice."""


@dataclass(frozen=True)
class Turning:
    """The angle by which the jaws must turn, and what turns them: a Kalman filter.

    The arm has k motors that bring the gripper to a place; one more turns it.

    The arm turns the gripper, too: whatever motor turns the whole arm turns the jaws against an object that
    lies still. Angles between lines are known up to half turns; some are seen quite wrongly.

    Attributes:
        state: The angle (rad), and the rates (rad a word) of the arm's motors and of the one that turns the
            gripper (k + 2,).
        covariance: Of what is not known of them (k + 2, k + 2).
        surprised: Whether the last angle was a surprise.
    """

    state: Array
    covariance: Array
    surprised: bool = False

    @classmethod
    def unknown(cls, arm: int) -> Self:
        """One of which nothing is known, of an arm of so many motors."""
        return cls(np.zeros(arm + 2), UNKNOWN**2 * np.eye(arm + 2))

    @property
    def angle(self) -> float | None:
        """By what angle (rad) the jaws must turn, within a quarter turn; None where that is not known."""
        return quarter(float(self.state[0])) if self._told else None

    @property
    def _told(self) -> bool:
        """Whether the angle is told from one of half a turn more."""
        return bool(np.sqrt(self.covariance[0, 0] + ANGLE**2) < AMBIGUOUS)

    @property
    def rates(self) -> Array:
        """Of the arm's motors, and of the one that turns the gripper (k + 1,)."""
        return self.state[1:]

    @property
    def known(self) -> bool:
        """Whether it is known which way the jaws turn, and about how far."""
        return bool(abs(self.state[-1]) > 2 * np.sqrt(self.covariance[-1, -1]))

    @property
    def longest(self) -> float:
        """The longest word of the turning motor whose turn is foreseen surely enough."""
        variance = self.covariance[-1, -1] + np.square(CURVED * self.state[-1])
        return float(min(1.0, SURE / np.sqrt(variance)))

    def moved(self, words: Array) -> Self:
        """The same after words (k + 1,) were executed, and before anything was seen."""
        step = np.eye(len(self.state))
        step[0, 1:] = -words
        covariance = step @ self.covariance @ step.T
        covariance[0, 0] += np.square(CURVED * self.rates * words).sum()
        return replace(self, state=step @ self.state, covariance=covariance)

    def seen(self, angle: float) -> Self:
        """The same after an angle (rad) was seen."""
        if not self._told:
            return self._begun(angle)
        column = self.covariance[0]
        variance = column[0] + ANGLE**2
        error = quarter(angle - float(self.state[0]))
        if abs(error) > SURPRISING * np.sqrt(variance):
            anew = self.unknown(len(self.state) - 2)
            return anew.seen(angle) if self.surprised else replace(self, surprised=True)
        covariance = self.covariance - np.outer(column, column) / variance
        return type(self)(self.state + column * error / variance, covariance)

    def _begun(self, angle: float) -> Self:
        """The same with another angle, which tells nothing of the rates."""
        state, covariance = self.state.copy(), self.covariance.copy()
        state[0], covariance[0], covariance[:, 0] = angle, 0.0, 0.0
        covariance[0, 0] = ANGLE**2
        return type(self)(state, covariance)

    def in_new_trial(self) -> Self:
        """The same before the next trial: another object, and motors may have changed."""
        later = self._begun(0.0)
        later.covariance[1:, 1:] += (AGED * UNKNOWN) ** 2 * np.eye(len(self.rates))
        later.covariance[0, 0] = UNKNOWN**2
        return later
