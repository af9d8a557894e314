"""Where motors stand: by the words that they were told, and by registers, which are measured and not exact.

No procedure asks registers whether a motor has moved: it is told here.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from .encoders import Encoders
from .observation import Array, Observation


class RegisterEstimate:
    """Where the motors stand in one trial: a Kalman filter that first asks what each motor has done.

    A motor that was sent nothing stands where it stood. One whose register is where its word leads has
    executed it; one whose register shows no change has not moved; else it stands where its register says.

    Attributes:
        registers: Where motors stand (m,).
        encoders: How registers tell it.

    Args:
        measured: What registers say (m,) where the trial begins.
        encoders: What is known of them; it learns on.
    """

    HOME = 0.1
    """A motor whose register is within this share of a full word is at home, where registers are zero (a
    guard: no encoder is so bad)."""
    INEXACT = 2.0
    """Words are executed inexactly where they end this much farther off than noise tells. Derived: the
    quantile of twenty words is known to a half."""

    def __init__(self, measured: Array, encoders: Encoders) -> None:
        at_home = np.abs(measured) < self.HOME
        self.registers = np.where(at_home, 0.0, measured)
        self.encoders = encoders
        encoders.rest(measured[at_home])
        self._measured = measured
        self._variances = np.zeros(len(measured))
        self._off = np.where(at_home, measured, np.nan)

    def words(self, wanted: Array) -> Array:
        """Words (m,) to send, so that motors execute those that are wanted (m,)."""
        return np.clip(np.clip(wanted, -1.0, 1.0) / self.encoders.share, -1.0, 1.0)

    def after(self, words: Array, measured: Array) -> Array:
        """Where motors stand (m,) after words (m,) were sent, by what registers say then (m,)."""
        sent, moved, known = words != 0, measured - self._measured, self.encoders
        off = moved - known.share * words
        known.read(measured)
        known.learn(words, moved, off, self._off)
        self._off = np.where(sent, off, self._off)
        told = self.registers + known.share * words
        resting, error, rounding = known.noise, known.error, known.ROUNDING
        noise = max(resting, known.noise_of_motions(error))
        exact = error <= self.INEXACT * sqrt(2) * noise
        variances = self._variances + np.where(sent, 0.0 if exact else error**2, 0.0)
        gain = np.where(sent, variances / (variances + noise**2 + rounding**2), 0.0)
        tells = max(known.GATE * max(error, noise), known.step / 2)
        as_told = np.abs(measured - told) <= tells + rounding
        stood = np.abs(moved) <= known.GATE * sqrt(2) * resting + rounding
        fused = told + gain * (measured - told)
        here = np.where(as_told, fused, np.where(stood, self.registers, measured))
        self.registers = np.where(np.abs(here - self.registers) <= rounding, self.registers, here)
        otherwise = np.where(stood, self._variances, noise**2)
        self._variances = np.where(as_told, (1 - gain) * variances, otherwise)
        self._measured = measured
        return self.registers


def at_home(first: Observation) -> Observation:
    """What a trial begins with, with registers as where motors stand."""
    return replace(first, registers=RegisterEstimate(first.registers, Encoders()).registers)
