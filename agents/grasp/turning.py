"""By how much motors turn the jaws, learned from motions that are made anyway (3.5)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from ..base.observation import Array
from .observation import ARM

TURNING = ARM
"""Place of the motor that turns the gripper among those that can: it follows the arm's."""
UNKNOWN = 3.0
"""Standard deviation of a rate (rad a word) of which nothing is known. Choice: a motor's word turns its joint
by two to five."""
ANGLE, CURVED = 0.15, 0.15
"""Standard deviation of an angle's change as it is seen (rad), and as a share of the expected one: motors are
curved. Choice: angles are seen to 0.1 near the object, and less well in images."""
AMBIGUOUS, SURE = np.pi / 4, np.pi / 6
"""A turn that is less surely foreseen (a deviation) is not told from half a turn more; turns are made as long
as they are foreseen more surely. Derived: angles between lines differ by two or three times that at most."""
SURPRISING = 3.0
"""A turn so many deviations away from the foreseen one tells that the object was pushed; two in a row, that
motors have changed. Derived: 0.3 %."""
AGED = 0.1
"""Of what is unknown at first, this share is unknown again in the next trial (a deviation). Choice."""


@dataclass(frozen=True)
class TurnRates:
    """Rates (rad a word) of the arm's motors and of the one that turns the gripper, by least squares.

    The arm turns the gripper, too: whatever motor turns the whole arm turns the jaws against an object that
    lies still.

    Attributes:
        rates: Of each motor (4,).
        covariance: Of what is not known of them (4, 4).
        surprised: Whether the last turn was a surprise.
    """

    rates: Array = field(default_factory=lambda: np.zeros(ARM + 1))
    covariance: Array = field(default_factory=lambda: UNKNOWN**2 * np.eye(ARM + 1))
    surprised: bool = False

    @property
    def known(self) -> bool:
        """Whether it is known which way the jaws turn, and about how far."""
        return bool(abs(self.rates[TURNING]) > 2 * np.sqrt(self.covariance[TURNING, TURNING]))

    def foreseen(self, words: Array) -> tuple[float, float]:
        """By what angle (rad) words (4,) turn the jaws, and its standard deviation."""
        turn = float(self.rates @ words)
        variance = words @ self.covariance @ words + ANGLE**2
        return turn, float(np.sqrt(variance + np.square(CURVED * self.rates * words).sum()))

    @property
    def longest(self) -> float:
        """The longest word of the turning motor whose turn is foreseen surely enough."""
        variance = self.covariance[TURNING, TURNING] + np.square(CURVED * self.rates[TURNING])
        return float(min(1.0, SURE / np.sqrt(variance)))

    def with_turn(self, words: Array, by: float) -> Self:
        """The same after words (4,) have turned the jaws by an angle (rad), or half turns more.

        Which, is told by the rates so far; where they do not tell, the turn teaches nothing.
        """
        expected, deviation = self.foreseen(words)
        if deviation > AMBIGUOUS:
            return self
        error = (by - expected + np.pi / 2) % np.pi - np.pi / 2
        if abs(error) > SURPRISING * deviation:
            return type(self)() if self.surprised else replace(self, surprised=True)
        gain = self.covariance @ words / deviation**2
        covariance = self.covariance - np.outer(gain, words @ self.covariance)
        return type(self)(self.rates + gain * error, covariance)

    def aged(self) -> Self:
        """The same in the next trial: motors may have changed."""
        covariance = self.covariance + (AGED * UNKNOWN) ** 2 * np.eye(ARM + 1)
        return replace(self, covariance=covariance)
