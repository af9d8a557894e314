"""Where motors stand: by the words that they were told, and by registers, which are measured and not exact.

An encoder is noisy and has steps, a controller ends short of its goal, a motion has a greatest length. So no
procedure asks registers whether a motor has moved: it is told here.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable
from dataclasses import replace
from statistics import median

import numpy as np

from .observation import Array, Flags, Observation


class RegisterEstimate:
    """Where the motors stand in one trial: a Kalman filter that first asks what each motor has done.

    A motor that was sent nothing stands where it stood. One whose register is where its word leads has
    executed it; one whose register shows no change has not moved; else it stands where its register says.
    Nothing here has a size in registers: how noisy they are, and how exactly words are executed, is learned
    from each motion, at no extra look.

    Attributes:
        registers: Where motors stand (m,).
        share: How much of a word motors usually execute.

    Args:
        measured: What registers say (m,) where the trial begins.
    """

    HOME = 0.1
    """A motor whose register is within this share of a full word is at home, where registers are zero (a
    guard: no encoder is so bad)."""
    GATE = 4.0
    """What differs by so many standard deviations is not the same. Derived: once in 16,000 cases."""
    MEDIAN, QUANTILE = (0.5, 0.6745), (0.15, 0.189)
    """Such a share of normal deviates is smaller than that; the second one also where motors often stop."""
    CAUTION = 2.0
    """By few deviates noise may look less than it is: by three as little as half (a guard)."""
    FEW = 4
    """So many words tell nothing of how exactly words are executed (a guard)."""
    UNDONE = 0.25
    """Registers are noisy where an error is undone by this share in the next motion. Derived: by a half where
    words are executed exactly, not at all where registers are exact."""
    ONE_SIDED = 0.5
    """Where three of four words end short, that is no noise. Choice."""
    INEXACT = 2.0
    """Words are executed inexactly where they end this much farther off than noise tells. Derived: the
    quantile of twenty words is known to a half."""
    SPREADS, MOST_SHORT = 4.0, 0.5
    """Words are usually executed in part where shares fall short of one by so many times what they differ by
    (median deviations), and by no more than half. Choice: else, what stops some motions is no rule."""
    ROUNDING = 4 * float(np.finfo(np.float32).eps)
    """Of registers (a guard): observations have single precision."""

    def __init__(self, measured: Array) -> None:
        at_home = np.abs(measured) < self.HOME
        self.registers = np.where(at_home, 0.0, measured)
        self.share = 1.0
        self._measured = measured
        self._variances = np.zeros(len(measured))
        self._off = np.where(at_home, measured, np.nan)
        self._resting = _Deviates(measured[at_home])
        self._errors = _Deviates()
        self._ahead = 0.0
        self._shares: list[float] = []
        self._in_a_row = np.empty((0, 2))

    def words(self, wanted: Array) -> Array:
        """Words (m,) to send, so that motors execute those that are wanted (m,)."""
        return np.clip(np.clip(wanted, -1.0, 1.0) / self.share, -1.0, 1.0)

    def after(self, words: Array, measured: Array) -> Array:
        """Where motors stand (m,) after words (m,) were sent, by what registers say then (m,)."""
        sent, moved = np.asarray(words != 0), measured - self._measured
        self._learn(sent, words, moved)
        told = self.registers + self.share * words
        resting = self._noise
        error = self._error(resting)
        noise = max(resting, self._noise_of_motions(error))
        exact = error <= self.INEXACT * np.sqrt(2) * noise
        variances = self._variances + np.where(sent, 0.0 if exact else error**2, 0.0)
        gain = np.where(sent, variances / (variances + noise**2 + self.ROUNDING**2), 0.0)
        as_told = np.abs(measured - told) <= self.GATE * max(error, noise) + self.ROUNDING
        stood = np.abs(moved) <= self.GATE * np.sqrt(2) * resting + self.ROUNDING
        fused = told + gain * (measured - told)
        here = np.where(as_told, fused, np.where(stood, self.registers, measured))
        self.registers = np.where(np.abs(here - self.registers) <= self.ROUNDING, self.registers, here)
        otherwise = np.where(stood, self._variances, noise**2)
        self._variances = np.where(as_told, (1 - gain) * variances, otherwise)
        self._measured = measured
        return self.registers

    def _learn(self, sent: Flags, words: Array, moved: Array) -> None:
        """Learns how noisy registers are, and how exactly words (m,) are executed."""
        self._resting.add(moved[~sent] / np.sqrt(2))
        off = moved - self.share * words
        self._errors.add(off[sent])
        self._ahead += float(np.sign(off * words).sum())
        in_a_row = np.stack([self._off, off], 1)[sent & np.isfinite(self._off)]
        self._in_a_row = np.concatenate([self._in_a_row, in_a_row])
        self._off = np.where(sent, off, self._off)
        clear = np.abs(words) > 2 * self.GATE * self._noise
        self._shares += (moved[clear] / words[clear]).tolist()
        if len(self._shares) > self.FEW:
            usual = median(self._shares)
            spread = median(abs(share - usual) for share in self._shares)
            self.share = usual if self.SPREADS * spread < 1 - usual < self.MOST_SHORT else 1.0

    @property
    def _noise(self) -> float:
        """Standard deviation of a register, by motors that were sent nothing."""
        looks = max(len(self._resting), 1)
        return self._resting.deviation(*self.MEDIAN) * (1 + self.CAUTION / looks)

    def _error(self, noise: float) -> float:
        """Standard deviation of how far registers, as noisy as this, move from what words tell."""
        if len(self._errors) <= self.FEW:
            return np.sqrt(2) * noise
        return self._errors.deviation(*self.QUANTILE)

    def _noise_of_motions(self, error: float) -> float:
        """Standard deviation of a register, by errors that the next motion undoes: of its steps, too."""
        if len(self._in_a_row) <= self.FEW or abs(self._ahead) > self.ONE_SIDED * len(self._errors):
            return 0.0
        usual = self._in_a_row[(np.abs(self._in_a_row) <= self.GATE * error).all(1)]
        if len(usual) <= self.FEW:
            return 0.0
        undone = -float(usual.prod(1).mean())
        return float(np.sqrt(undone)) if undone > self.UNDONE * error**2 else 0.0


class _Deviates:
    """How far values lie from zero, in order."""

    def __init__(self, values: Iterable[float] = ()) -> None:
        self._sizes: list[float] = []
        self.add(values)

    def __len__(self) -> int:
        return len(self._sizes)

    def add(self, values: Iterable[float]) -> None:
        for value in values:
            insort(self._sizes, abs(float(value)))

    def deviation(self, share: float, of_normal: float) -> float:
        """The standard deviation, where this share of normal deviates is smaller than `of_normal` of it."""
        if not self._sizes:
            return 0.0
        below, part = divmod(share * (len(self) - 1), 1.0)
        sizes = self._sizes[int(below) : int(below) + 2]
        return (sizes[0] + part * (sizes[-1] - sizes[0])) / of_normal


def at_home(first: Observation) -> Observation:
    """What a trial begins with, with registers as where motors stand."""
    return replace(first, registers=RegisterEstimate(first.registers).registers)
