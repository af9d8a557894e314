"""One trial as a servo lives through it: its motions, and what they tell of motors and Jacobian."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np

from agents.base.agent import Array, Look
from agents.jacobian import Estimator, Flags, both_points, displacement_px, distance_jacobian
from agents.perception.observation_filter import Senses

Motions = Generator[Array, Look, Any]
"""Yields control words, is sent what was seen after them."""


class Trial:
    """What a servo knows in a trial, and the motions that all servos are made of.

    Attributes:
        look: What is believed after the last motion.
        senses: What is known of looks.
        estimator: What is known of the Jacobian.
        known: For which points and motors (4, m) that was learned from motions.
        test_words: The next test word of each motor (m,).
        object_jumped: Whether the object was last seen where J cannot have brought it.
        lowest, highest: Registers (m,) at which motors are known to stop.

    Args:
        look: The first look.
        estimator: What to begin with.
        first_word: Size of the very first test words.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
    """

    TRIES = 6
    SHORT = 1e-4
    """A motor that executes so much less than its word has met a stop."""
    SMALLEST_TEST, LARGEST_TEST = 0.01, 0.5
    NOISES = 8.0
    """A test motion is to move the images by so many times the noise."""
    CLEAR, HIDDEN = 4.0, 3.0
    """A column is measured until it is so many times longer than its standard deviation; and anew below."""

    def __init__(self, look: Look, estimator: Estimator, first_word: float, test_px: float) -> None:
        motors = len(look.registers)
        self.look = look
        self.senses = Senses()
        self.estimator = estimator
        self.known = np.tile(estimator.jacobian.any(0), (4, 1))
        self.test_words = np.full(motors, first_word)
        self.lowest = np.full(motors, -1.0)
        self.highest = np.full(motors, 1.0)
        self.object_jumped = False
        self._seen_at = np.tile(look.registers, (4, 1))
        self._tested = np.zeros(motors)
        self._confirmed = np.zeros(4, bool)
        self._test_px = test_px

    def begin(self) -> Motions:
        """Looks until all points were seen."""
        self.look = yield from self.senses.first(self.look)

    def move(self, words: Array) -> Motions:
        """Executes words (m,), and learns; returns executed words and the points' displacement (8,)."""
        before = self.look
        look = yield words
        executed = look.registers - before.registers
        moving = executed != 0
        expected = self.estimator.jacobian @ executed
        known = np.asarray(self.known[:, moving].all(1))
        look = yield from self.senses.settle(look, before, expected, known)
        short = words - executed
        if np.abs(short).max() > self.SHORT:
            self.highest = np.where(short > self.SHORT, look.registers, self.highest)
            self.lowest = np.where(short < -self.SHORT, look.registers, self.lowest)
        surprising = self.senses.surprising
        self.object_jumped = bool((surprising & known)[2:].any())
        doubtful = surprising & (~self._confirmed | self.object_jumped)
        believable = look.visible & (before.visible | self.estimator.bridging) & ~doubtful
        self._confirmed |= look.visible
        start, seen = both_points(before), both_points(look)
        self.estimator.noise_px = self.senses.noise_px
        moved = self.estimator.learn(executed, seen - start, np.repeat(believable, 2))
        moved = np.where(np.repeat(look.visible & ~believable, 2), seen - start, moved)
        self.look = look.believed(start + moved, look.visible)
        self.estimator.trusted.append(look.believed(seen, look.visible & ~doubtful))
        self._seen_at[look.visible] = look.registers
        if np.count_nonzero(moving) == 1:
            self.known[believable, moving.argmax()] = True
        while self.senses.curious:
            yield from self.move(np.zeros(len(words)))
        return executed, moved

    def go_back(self) -> Motions:
        """Returns to where a point that is not seen any more was seen last."""
        lost = int(self.senses.lost.argmax())
        yield from self.move(self._seen_at[lost] - self.look.registers)

    def move_in_view(self, words: Array) -> Motions:
        """Executes words (m,), and where that loses a point from view, goes half of the way back."""
        before = self.look
        yield from self.move(words)
        while self.senses.lost.any():
            yield from self.move((before.registers - self.look.registers) / 2)

    def test(self, motor: int) -> Motions:
        """Measures one motor's column of the Jacobian by a test motion, towards the object as last known.

        Where the motor meets its stop or a point gets lost it tries the other way; where too little moves in
        the images to be told from noise it tries a larger word, back and forth.
        """
        slope = distance_jacobian(self.estimator.jacobian)[:, motor] @ self.look.distance
        if slope:
            self.test_words[motor] = -np.sign(slope) * abs(self.test_words[motor])
        for _ in range(self.TRIES):
            words = np.zeros(len(self.test_words))
            words[motor] = self.test_words[motor]
            executed, moved = yield from self.move(words)
            if self.senses.lost.any():
                self.test_words[motor] *= -0.5
                yield from self.go_back()
            elif abs(executed[motor]) < 0.5 * abs(words[motor]):
                self.test_words[motor] *= -1
            else:
                self._tested[motor] = executed[motor]
                self._adapt(motor, float(executed[motor]), displacement_px(moved))
                if self._measured(self.CLEAR)[motor]:
                    return
                self.test_words[motor] *= -1

    def test_hidden(self) -> Motions:
        """Test motions of all motors of which nothing is known or no more than noise, one after the other."""
        for motor, measured in enumerate(self._measured(self.HIDDEN)):
            if not measured:
                yield from self.test(motor)

    def _measured(self, times: float) -> Flags:
        """Which columns (m,) were learned, and are so many times longer than their standard deviation."""
        columns = self.estimator.jacobian
        lengths = np.hypot(columns[::2], columns[1::2]).max(0)
        clear = lengths > times * self.estimator.deviations(self._tested)
        return np.asarray(self.known.all(0) & (clear | (self._tested == 0)))

    def forget(self, deviation: float = 2.0) -> None:
        """Trusts J no more than a guess, see `Estimator.forget`; test words get their size by it."""
        self.estimator.forget(deviation)
        self.known[:] = False
        for motor, column in enumerate(self.estimator.jacobian.T):
            if column.any():
                self._adapt(motor, self.test_words[motor], displacement_px(column * self.test_words[motor]))

    def _adapt(self, motor: int, word: float, pixels: float) -> None:
        wanted = max(self._test_px, self.NOISES * self.senses.noise_px)
        size = word * np.clip(wanted / max(pixels, 0.1), 0.25, 4)
        size = np.sign(size) * max(abs(size), self.SMALLEST_TEST)
        self.test_words[motor] = np.clip(size, -self.LARGEST_TEST, self.LARGEST_TEST)
