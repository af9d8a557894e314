"""Where motors stand: by the words that they were told, and by registers, which are measured and not exact.

No procedure asks registers whether a motor has moved or met a stop: it is told here. An encoder is noisy and
has steps, a controller ends short of its goal. All of it is learned from motions that are made anyway, and
stays from trial to trial: a robot keeps its encoders.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import replace
from math import fmod, inf, sqrt
from statistics import median
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .checks import check_number, checked_array
from .observation import Array, Observation

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


class Encoders:
    """How noisy registers are, and how exactly words are executed. Nothing here has a size in registers.

    Attributes:
        share: How much of a word motors usually execute.
        noise: Standard deviation of a register, by motors that were sent nothing.
    """

    NAME = "registers."
    """How the names of its arrays begin."""
    GATE = 4.0
    """What differs by so many standard deviations is not the same. Derived: once in 16,000 cases."""
    KEPT = 50
    """So many words are remembered. Choice: a robot's first reaches."""
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
    SPREADS, MOST_SHORT = 4.0, 0.5
    """Words are usually executed in part where shares fall short of one by so many times what they differ by
    (median deviations), and by no more than half. Choice: else, what stops some motions is no rule."""
    ROUNDING = 4 * float(np.finfo(np.float32).eps)
    """Of registers (a guard): observations have single precision."""
    DIVIDED = 300 * float(np.finfo(np.float32).eps)
    """Of the largest register (a guard): as far off is what is left of several divisions."""
    MOST, LEAST = 1e100, 1e-100
    """Of what is kept, and of a step (a guard far beyond any register: squares and quotients stay finite)."""

    def __init__(self) -> None:
        self.share, self.noise = 1.0, 0.0
        self._resting = deque[float](maxlen=self.KEPT)
        self._errors = deque[float](maxlen=self.KEPT)
        self._shares = deque[float](maxlen=self.KEPT)
        self._in_a_row = deque[tuple[float, float]](maxlen=self.KEPT)
        self._step, self._farthest = inf, 0.0

    def rest(self, off: Array) -> None:
        """Registers of motors that have not moved are so far off (n,)."""
        self._resting.extend(off.tolist())
        noise = _deviation(self._resting, *self.MEDIAN)
        self.noise = noise * (1 + self.CAUTION / max(len(self._resting), 1))

    def learn(self, words: Array, moved: Array, off: Array, before: Array) -> None:
        """Learns from what registers have made of words.

        Args:
            words: What motors were sent (m,).
            moved: By how much registers have changed (m,).
            off: By how much more than words told (m,).
            before: The same, the last time that each motor was sent anything (m,); NaN where it was not.
        """
        sent = words != 0
        self.rest(moved[~sent] / sqrt(2))
        self._errors.extend((off * np.sign(words))[sent].tolist())
        in_a_row = sent & np.isfinite(before)
        self._in_a_row.extend(zip(before[in_a_row].tolist(), off[in_a_row].tolist(), strict=True))
        clear = np.abs(words) > 2 * self.GATE * self.noise
        self._shares.extend((moved[clear] / words[clear]).tolist())
        if len(self._shares) > self.FEW:
            usual = median(self._shares)
            spread = median(abs(share - usual) for share in self._shares)
            self.share = usual if self.SPREADS * spread < 1 - usual < self.MOST_SHORT else 1.0

    def read(self, registers: Array) -> None:
        """Learns from registers (m,) which step they have, if any."""
        for reading in np.abs(registers).tolist():
            self._farthest = max(self._farthest, reading)
            self._step = _common_step(self._step, reading, self.DIVIDED * self._farthest)
            if self._step < self._farthest:
                self._step = self._farthest / round(self._farthest / self._step)

    @property
    def step(self) -> float:
        """What registers are multiples of, if anything: one reading alone is no evidence of it."""
        return self._step if self._farthest > 1.5 * self._step else 0.0

    @property
    def error(self) -> float:
        """Standard deviation of how far registers move, from what words tell."""
        if len(self._errors) <= self.FEW:
            return sqrt(2) * self.noise
        return _deviation(self._errors, *self.QUANTILE)

    def noise_of_motions(self, error: float) -> float:
        """Standard deviation of a register, its step included, by errors that the next motion undoes.

        Args:
            error: How far registers usually move from what words tell.
        """
        ahead = sum(off > 0 for off in self._errors) - sum(off < 0 for off in self._errors)
        if abs(ahead) > self.ONE_SIDED * len(self._errors):
            return 0.0
        most = self.GATE * error
        undone = [-one * two for one, two in self._in_a_row if -most <= one <= most and -most <= two <= most]
        variance = sum(undone) / max(len(undone), 1)
        if len(undone) > self.FEW and variance > self.UNDONE * error**2:
            return sqrt(variance)
        return min(error, self.step / sqrt(12)) if len(undone) < self.KEPT else 0.0

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that is known, as named arrays."""
        return {
            f"{self.NAME}resting": np.array(self._resting),
            f"{self.NAME}errors": np.array(self._errors),
            f"{self.NAME}shares": np.array(self._shares),
            f"{self.NAME}in_a_row": np.array(self._in_a_row).reshape(-1, 2),
            f"{self.NAME}other": np.array([self.share, self._step, self._farthest]),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """What `arrays` returned of one; nothing is known where a file of an earlier version has none.

        Raises:
            ValueError: They are damaged.
        """
        known = cls()
        if f"{cls.NAME}other" in arrays:
            resting, errors, shares, in_a_row = (
                checked_array(arrays, f"{cls.NAME}{name}", (None, *pairs), most=cls.MOST)
                for name, *pairs in (("resting",), ("errors",), ("shares",), ("in_a_row", 2))
            )
            known.rest(resting)
            known._errors.extend(errors.tolist())
            known._shares.extend(shares.tolist())
            known._in_a_row.extend((one, two) for one, two in in_a_row.tolist())
            other = checked_array(arrays, f"{cls.NAME}other", (3,), allow_nan=True, most=cls.MOST)
            share, step, farthest = other.tolist()
            known.share = check_number("the share of words", share, least=1 - cls.MOST_SHORT, most=1)
            known._step = check_number("the step of registers", step, least=cls.LEAST, finite=False)
            known._farthest = check_number("the farthest register", farthest, least=0, most=cls.MOST)
        return known


def _common_step(step: float, reading: float, rounding: float) -> float:
    """What two values are multiples of (Euclid); hardly anything, where of nothing."""
    while reading > rounding:
        left = fmod(step, reading) if step < inf else 0.0
        step, reading = reading, min(left, reading - left)
    return step


def _deviation(values: Iterable[float], share: float, of_normal: float) -> float:
    """The standard deviation, where this share of normal deviates is smaller than `of_normal` of it."""
    sizes = sorted(map(abs, values))
    if not sizes:
        return 0.0
    below, part = divmod(share * (len(sizes) - 1), 1.0)
    low, high = sizes[int(below)], sizes[min(int(below) + 1, len(sizes) - 1)]
    return (low + part * (high - low)) / of_normal


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
