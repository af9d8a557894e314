"""A leash around where a robot has been: as long as the images have shown that it knows itself."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from calfree_gym.image import lengths_px

from ...base.observation import POINTS, Array, Observation
from ...base.procedure import Procedure
from ...base.stops import Stops, met_something
from ...perception import ObservationFilter
from .linear_view import LinearView

SPAN_PX = 600.0
"""How far a servo's word of 1 moves the images. Choice: about what a word of the built robot's motors does,
so that servos find motors as they know them, however weak or strong each is."""


def equal_units(jacobian: Array, tested: Array) -> Array:
    """Words (m,), each moving the images by `SPAN_PX`, at most 1; of unseen motors, four times `tested`."""
    moved = lengths_px(jacobian.reshape(POINTS, 2, -1).swapaxes(1, 2)).max(0)
    return np.where(moved > 0, np.minimum(SPAN_PX / np.maximum(moved, 1.0), 1.0), 4 * tested)


def in_units(observation: Observation, units: Array) -> Observation:
    """An observation with its registers in these units (m,)."""
    return replace(observation, registers=observation.registers / units)


class Leash:
    """Lets through as much of a servo's words as stays near registers where the robot has been.

    It is as long as the images may move by one motion, as expected, and by each motor's word alone: what
    motors do to images may cancel, what they do to the arm does not. It grows where they did as expected,
    and shrinks where not, or where a point was lost or the arm met something. Near the object, where there
    may be less room than on the way, motions are short, and so they are slow.

    Attributes:
        length_px: How far a motion may move the images, far from the object.
        now: The last look.
        contacts: How often the arm has met something.
        stops: Where motors are known to stop.

    Args:
        now: The last look.
        view: What is known of the Jacobian.
        tested: How far each motor (m,) has been.
        filter_: What is known of observations.
        units: What the servo takes for a word of 1, of each motor (m,).
    """

    FIRST_PX = 32.0
    """At first. Choice: a little more than first motions did, and 2 cm at the gripper."""
    OF_DISTANCE, NEAR_PX = 0.5, 12.0
    """No motion is longer than this share of the image distance, or where that is shorter, than this. Choice:
    on worlds 1000 to 1299, of the pairs (0.35, 8), (0.5, 12) and none, this was safest."""
    LEAST_PX = 2.0
    """At least (a guard)."""
    MOST_PX = 40.0
    """At most. Choice: of 24 to 64, on worlds 1000 to 1299 nothing is better."""
    GROWTH = 2.0
    """By this factor it grows, and shrinks. Choice: as first motions do."""
    AS_EXPECTED = 0.35
    """The images did as expected where they are off by no more than this share of the motion. Choice."""
    NOISES = 6.0
    """Or by no more than so many standard deviations of their noise. Derived: 4 √2, and a margin."""
    FARTHER = 4.0
    """No motor goes farther than this times where it has been, whatever the images are expected to do.
    Choice: a motor whose motions are not seen may not run away."""
    MOST_SHARE = 0.9
    """Words that are shortened are shortened at least to this share. Choice: so servos tell it from a motor's
    stop."""
    DONE = 0.1
    """A word is executed of which no more than this share is left. Choice: motors may fall short of words."""
    PARTS = 8
    """In so many motions at most a single motor's words are executed (a guard)."""
    MOST_CONTACTS = 6
    """The robot gives up where it has met something so often. Choice."""

    def __init__(
        self,
        now: Observation,
        view: LinearView,
        tested: Array,
        filter_: ObservationFilter,
        units: Array,
    ) -> None:
        self._units = units
        self.now, self.length_px = now, self.FIRST_PX
        self.contacts, self.stops = 0, Stops(now.registers)
        self._view, self._tested, self._filter = view, tested, filter_

    def allowed(self, words: Array, registers: Array) -> Array:
        """As much of words (m,), from registers (m,) on, as the leash lets through, in the same direction."""
        share = 1.0 / max(1.0, float(np.abs(words).max()))
        far = max(self._view.moved_px(words), self._view.each_px(words))
        length_px = min(self.length_px, max(self.OF_DISTANCE * self.now.distance_px, self.NEAR_PX))
        if far > length_px:
            share = min(share, length_px / far)
        beyond = np.abs(registers + words) > self.FARTHER * self._tested
        for motor in np.flatnonzero(beyond & (words != 0)):
            room = self.FARTHER * self._tested[motor] - np.sign(words[motor]) * registers[motor]
            share = min(share, max(float(room / abs(words[motor])), 0.0))
        return words if share == 1 else min(share, self.MOST_SHARE) * words

    def learn(self, words: Array, before: Observation, after: Observation) -> bool:
        """Takes in what words (m,) did; whether all went as expected."""
        executed = after.registers - before.registers
        met = self.stops.learn(words, words - executed, after.registers)
        self.contacts += met
        expected_px = self._view.moved_px(executed)
        off_px = self._view.error_px(executed, before, after)
        lost = bool((before.visible & ~after.visible).any())
        most = max(self.NOISES * self._filter.noise.px, self.AS_EXPECTED * expected_px)
        well = off_px <= most and not lost and not met
        if not well:
            self.length_px = max(self.length_px / self.GROWTH, self.LEAST_PX)
        elif expected_px > self.length_px / self.GROWTH:
            self.length_px = min(self.length_px * self.GROWTH, self.MOST_PX)
        self._view.correct(executed, before, after, self._filter.noise.px)
        self.now = after
        self._tested = np.maximum(self._tested, np.abs(after.registers))
        return well

    def hold(self, servo: Procedure, whole: bool = True) -> Generator[Array, Observation, str]:
        """Lets a servo go on from here until it ends; why it was given up, or nothing.

        A servo that moves several motors goes on from where the leash has stopped it. Words of a single
        motor, and those that lead a motor to its stop, are executed in parts: a servo would take any motor
        whose words were cut short by itself for one at its stop.

        Args:
            servo: In units.
            whole: Whether those are executed in parts; else the servo goes on after each motion.
        """
        words = next(servo, None)
        while words is not None:
            words = words * self._units
            there = self.now.registers + words
            target = np.clip(there, self.stops.lowest, self.stops.highest)
            left = target - self.now.registers
            in_parts = whole and (np.count_nonzero(words) == 1 or bool((target != there).any()))
            stood = np.zeros(len(words), bool)
            for _ in range(self.PARTS):
                before = self.now
                part = self.allowed(left, before.registers)
                now = yield part
                self.learn(part, before, now)
                if self.contacts >= self.MOST_CONTACTS:
                    return f"the arm met something {self.contacts} times on its way"
                short = part - (now.registers - before.registers)
                if met_something(part, short):
                    break
                stood |= (part != 0) & (short == part)
                in_parts |= whole and bool(stood.any())
                left = np.where(stood, 0.0, target - now.registers)
                done = not in_parts or bool((np.abs(left) <= self.DONE * np.abs(words)).all())
                if now.last or done or (before.visible & ~now.visible).any():
                    break
            try:
                words = servo.send(in_units(self.now, self._units))
            except StopIteration:
                words = None
        return ""
