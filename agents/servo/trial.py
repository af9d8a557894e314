"""One trial as a servo lives through it: its motions, and what they tell of motors and Jacobian."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np

from agents.agent import Array, Look
from agents.jacobian import (
    Estimator,
    both_points,
    both_seen,
    displacement_px,
    distance_jacobian,
)
from agents.sensing import Senses

Motions = Generator[Array, Look, Any]
"""Yields control words, is sent what was seen after them."""


class Trial:
    """What a servo knows in a trial, and the motions that all servos are made of.

    Attributes:
        look: What was seen last.
        estimator: What is known of the Jacobian.
        test_words: The next test word of each motor (m,).
        lowest, highest: Registers (m,) at which motors are known to stop.

    Args:
        look: The first look.
        estimator: What to begin with.
        first_word: Size of the very first test words.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
    """

    TRIES = 5
    LARGEST_TEST = 0.5

    def __init__(self, look: Look, estimator: Estimator, first_word: float, test_px: float) -> None:
        self.look = look
        self.senses = Senses(look)
        self.measured = estimator.jacobian.any(0)
        self.estimator = estimator
        self.test_words = np.full(len(look.registers), first_word)
        self.lowest = np.full(len(look.registers), -1.0)
        self.highest = np.full(len(look.registers), 1.0)
        self._test_px = test_px

    def begin(self) -> Motions:
        """Looks until all points were seen."""
        self.look = yield from self.senses.first(self.look)

    def move(self, words: Array) -> Motions:
        """Executes words (m,), and learns; returns executed words and the points' displacement (8,)."""
        before = self.look
        look = yield words
        executed = look.registers - before.registers
        expected = self.estimator.jacobian @ executed
        known = bool(self.measured[executed != 0].all())
        self.look = yield from self.senses.settle(look, before, expected, known)
        executed = self.look.registers - before.registers
        short = words - executed
        self.highest = np.where(short > 1e-4, self.look.registers, self.highest)
        self.lowest = np.where(short < -1e-4, self.look.registers, self.lowest)
        moved = both_points(self.look) - both_points(before)
        self.estimator.noise_px = self.senses.noise_px
        if self.senses.noisy:
            points, self.estimator.jacobian = self.senses.fit(self.look.registers, self.estimator.jacobian)
            self.look = replace(self.look, gripper=points[:4], object=points[4:])
        elif executed.any() and not self.senses.jumped[2:].any():
            self.estimator.learn(executed, moved, both_seen(before) & both_seen(self.look))
        return executed, moved

    def test(self, motor: int) -> Motions:
        """Measures one motor's column of the Jacobian by a test motion, towards the object as last known.

        Where the motor meets its stop or a point gets lost it tries the other way; where too little moves in
        the images to be told from noise it tries a larger word.
        """
        slope = distance_jacobian(self.estimator.jacobian)[:, motor] @ self.look.distance
        if slope:
            self.test_words[motor] = -np.sign(slope) * abs(self.test_words[motor])
        for _ in range(self.TRIES):
            words = np.zeros(len(self.test_words))
            words[motor] = self.test_words[motor]
            before = self.look
            executed, moved = yield from self.move(words)
            if not self.look.visible.all():
                self.test_words[motor] *= -0.5
                yield from self.move(before.registers - self.look.registers)
            elif abs(executed[motor]) < 0.5 * abs(words[motor]):
                self.test_words[motor] *= -1
            else:
                pixels = displacement_px(moved)
                self._adapt(motor, float(executed[motor]), pixels)
                enough = 0.25 * self.test_px
                self.measured[motor] |= pixels > enough
                if pixels > enough:
                    return

    def test_all(self) -> Motions:
        """Test motions of all motors, one after the other."""
        for motor in range(len(self.test_words)):
            yield from self.test(motor)

    @property
    def test_px(self):
        return max(self._test_px, 5 * self.senses.noise_px)

    def forget(self):
        self.estimator.forget()
        self.measured[:] = False

    def resize_tests(self) -> None:
        """Gives test words the size that they should have by the Jacobian as last known."""
        for motor, column in enumerate(self.estimator.jacobian.T):
            if column.any():
                self._adapt(motor, self.test_words[motor], displacement_px(column * self.test_words[motor]))

    def _adapt(self, motor: int, word: float, pixels: float) -> None:
        size = word * np.clip(self.test_px / max(pixels, 0.1), 0.25, 4)
        size = np.sign(size) * max(abs(size), 0.01)
        self.test_words[motor] = np.clip(size, -self.LARGEST_TEST, self.LARGEST_TEST)
