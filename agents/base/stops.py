"""Where motors are known to stop, and what tells that an arm has met something."""

from __future__ import annotations

from copy import copy

import numpy as np

from .observation import Array

ALIKE = 0.1
"""Shares of words that differ by less are the same (a guard: motors' curves bend them)."""


def met_something(words: Array, short: Array) -> bool:
    """Whether all words (m,), two at least, were executed but for the same share: `short` (m,)."""
    sent = words != 0
    shares = short[sent] / words[sent]
    return len(shares) > 1 and bool(shares.min() > ALIKE / 2 and np.ptp(shares) < ALIKE)


class Stops:
    """Where motors are known to stop.

    A motor stops where it fell short of most of its word, and then did not move at all by another one in the
    same direction: else it may only be slow, or its register coarse.

    Attributes:
        found: Stops that were found, lower and upper ones (2, m); infinite where none is known.
        been: The lowest and the highest registers (2, m) where motors have been.

    Args:
        registers: Where motors stand (m,).
    """

    NOTHING = 1e-6
    """So small a share of the longest word is none (a guard above rounding)."""

    def __init__(self, registers: Array) -> None:
        self.been = np.tile(registers, (2, 1))
        self._word = np.outer([-1.0, 1.0], np.ones(len(registers)))
        self.forget()

    def forget(self) -> None:
        """No stop is known."""
        self.found = np.inf * self._word
        self._fell_short = np.full_like(self.been, np.nan)

    def of(self, units: Array) -> Stops:
        """The same, of registers in these units (m,)."""
        stops = copy(self)
        stops.found, stops.been, stops._word = self.found / units, self.been / units, self._word / units
        stops._fell_short = self._fell_short / units
        return stops

    @property
    def lowest(self) -> Array:
        """Registers (m,) that no motor passes: its stop, or a word beyond the lowest where it has been."""
        return np.asarray(np.maximum(self.found[0], self.been[0] + self._word[0]))

    @property
    def highest(self) -> Array:
        """The same on the other side."""
        return np.asarray(np.minimum(self.found[1], self.been[1] + self._word[1]))

    def learn(self, words: Array, short: Array, registers: Array) -> bool:
        """Motors whose words (m,) were executed but for `short` (m,) stand at `registers` (m,).

        Where several were, all but for the same share, the arm has met something: that is no motor's stop.

        Returns:
            Whether it has.
        """
        self.been, self.found = (
            np.stack([np.minimum(each[0], registers), np.maximum(each[1], registers)])
            for each in (self.been, self.found)
        )
        if met_something(words, short):
            return True
        told = self._word * words > self.NOTHING * self._word**2
        stays = told & (short == words)
        self.found = np.where(stays & (self._fell_short == registers), registers, self.found)
        fell = np.where(2 * short * words > words**2, registers, np.nan)
        self._fell_short = np.where(told, fell, self._fell_short)
        return False
