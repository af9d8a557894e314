"""The paper's second implementation: all motors treated alike (section 3.2)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from agents.agent import Array, Look, Procedure
from agents.jacobian import both_points, distance_jacobian, solve_within
from calfree_gym.world import IMAGE_UNIT


@dataclass(frozen=True)
class UnifiedServo:
    """Test motions before every step, least squares, bounded steps; J is forgotten after each step.

    Attributes:
        first_word: Size of the very first test word.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
        step_px: No step is predicted to move a point further than this in an image.
        damping: Of the least squares, relative to the columns' length.
        border: Steps are predicted to keep every point within this part of the images.
    """

    first_word: float = 0.04
    test_px: float = 16.0
    step_px: float = 200.0
    damping: float = 0.05
    border: float = 0.95

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < np.inf:
                raise ValueError(f"{name} is {value!r}; it must be a number, 0 or more")
        if not 0 < self.first_word <= 1 or self.test_px == 0 or self.step_px == 0 or self.border == 0:
            raise ValueError(f"{self!r}: 0 < first_word <= 1; test_px, step_px and border above 0")

    def __call__(self, look: Look) -> Procedure:
        """Seeks the rendezvous from `look` on, for as long as it is asked."""
        motors = Motors(np.full(len(look.registers), self.first_word))
        jacobian = np.zeros((8, len(look.registers)))
        while True:
            for motor in range(len(look.registers)):
                motors.turn_towards(look, jacobian, motor)
                look, jacobian[:, motor] = yield from self._test_motion(look, motors, motor)
            words = self._step(look, jacobian, motors)
            before, look = look, (yield words)
            motors.learn_stops(before, look, words)
            if not look.visible.all():
                look = yield before.registers - look.registers

    def _test_motion(
        self, look: Look, motors: Motors, motor: int
    ) -> Generator[Array, Look, tuple[Look, Array]]:
        """Moves one motor a little; returns the new look and the Jacobian's column (8,).

        Where the motor meets its stop or a point gets lost it tries the other way; where too little
        moves in the images to be told from noise it tries a larger word.
        """
        for _ in range(4):
            word = np.zeros(len(motors.test_words))
            word[motor] = motors.test_words[motor]
            before, look = look, (yield word)
            motors.learn_stops(before, look, word)
            executed = (look.registers - before.registers)[motor]
            if not look.visible.all():
                motors.test_words[motor] *= -0.5
                look = yield before.registers - look.registers
            elif abs(executed) < 0.5 * abs(word[motor]):
                motors.test_words[motor] *= -1
            else:
                moved = both_points(look) - both_points(before)
                pixels = displacement_px(moved)
                size = np.clip(self.test_px / max(pixels, 0.1), 0.25, 4) * executed
                motors.test_words[motor] = np.clip(size, -0.5, 0.5)
                if pixels > 0.25 * self.test_px:
                    return look, moved / executed
        return look, np.zeros(8)

    def _step(self, look: Look, jacobian: Array, motors: Motors) -> Array:
        """Control words (m,) of one step towards the object, bounded in what they are to do."""
        lowest, highest = motors.lowest - look.registers, motors.highest - look.registers
        words = solve_within(distance_jacobian(jacobian), look.distance, self.damping, lowest, highest)
        moved = jacobian @ words
        shares = [self.step_px / max(displacement_px(moved), 1e-9), 1.0]
        points = both_points(look)
        leaving = np.abs(points + moved) > np.maximum(self.border, np.abs(points))
        if leaving.any():
            room = np.maximum(self.border - np.sign(moved) * points, 0.0)[leaving]
            shares.append(max(0.1, float((room / np.abs(moved[leaving])).min())))
        return words * min(shares)


@dataclass
class Motors:
    """What a servo learns of its motors during a trial.

    Attributes:
        test_words: The next test word of each (m,).
        lowest, highest: Registers (m,) at which they are known to stop.
    """

    test_words: Array
    lowest: Array = field(init=False)
    highest: Array = field(init=False)

    def __post_init__(self) -> None:
        self.lowest = np.full(len(self.test_words), -1.0)
        self.highest = np.full(len(self.test_words), 1.0)

    def turn_towards(self, look: Look, jacobian: Array, motor: int) -> None:
        """Gives a test word the sign that, as last known, leads towards the object."""
        slope = distance_jacobian(jacobian)[:, motor] @ look.distance
        if slope:
            self.test_words[motor] = -np.sign(slope) * abs(self.test_words[motor])

    def learn_stops(self, before: Look, after: Look, words: Array) -> None:
        """Remembers where motors stopped short of their words (m,)."""
        short = words - (after.registers - before.registers)
        self.highest = np.where(short > 1e-4, after.registers, self.highest)
        self.lowest = np.where(short < -1e-4, after.registers, self.lowest)


def displacement_px(moved: Array) -> float:
    """The largest displacement of one point in one image, of points (8,) in image units, in pixels."""
    return float(np.sqrt((moved * moved).reshape(-1, 2).sum(1)).max()) / IMAGE_UNIT
