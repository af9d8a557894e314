"""Steps: words that would bring the gripper to the object, made as long as the Jacobian can be trusted."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import lengths_px

from ..base.observation import Array
from ..perception.gating import Gating
from .redundancy import REDUNDANCIES, solve_within
from .trial import Motions, Trial

HARDLY_NEARER = 0.7
"""A motion came hardly nearer that left more than this share of the distance. Choice."""


def solve_distance(trial: Trial, redundancy: str, damping: float) -> Array:
    """Control words c (m,) that solve -d = J c between the motors' stops (equation 1 of the paper).

    Args:
        trial: Knows d and J.
        redundancy: What is done with four equations for three words, of `REDUNDANCIES`.
        damping: See `redundancy.solve`.
    """
    equations = REDUNDANCIES[redundancy](trial.jacobian, trial.now.distance, trial.estimator.noise_px)
    return solve_within(*equations, damping, *trial.word_bounds)


class Steps:
    """The steps of one trial.

    Args:
        trial: The trial.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        border: Steps are predicted to keep every point within this part of the images.
        doubting: Where steps come hardly nearer, points may be noisy and gears may have play: then it looks
            again, and goes beyond and back.
    """

    SHORTER, LONGER = 0.4, 1.5
    """Steps get shorter by this where one lost a point from view, and longer again with each that did not:
    tuned on wild worlds 3000 and up."""
    UNFINISHED = 0.1
    """A motor has not finished its word of which more than this share is left. Choice."""
    LOOKS = 6
    """So often it looks again. Choice: about as many motions as a step and its test motions take."""
    LEAST_SHARE = 0.1
    """A step that leads out of the images keeps this share at least: else nothing would move (a guard)."""

    def __init__(
        self, trial: Trial, step_px: float, step_word: float, border: float, doubting: bool = False
    ) -> None:
        self.trial = trial
        self.confidence = 1.0
        self._hardly_nearer = False
        self._last_px = np.inf
        self._step_px = step_px
        self._step_word = step_word
        self._border = border
        self._doubting = doubting

    def make(self, words: Array) -> Motions:
        """Executes words (m,) as far as they may go; where a point got lost, goes back, and then shorter.

        After a step that came hardly nearer it may go a test word beyond, and back: small words may do
        nothing, and gears have play.
        """
        before_px = self.trial.now.distance_px
        words = self.confidence * self.bounded(words)
        self.trial.findings.note_words(words, self.trial.now, self.trial.stops)
        goal = self.trial.now.registers + words
        if self._doubting and self._hardly_nearer:
            yield from self._go(goal + np.copysign(self.trial.test_words, words))
        if not self.trial.filter.lost.any():
            yield from self._go(goal)
        yield from self._look()
        self._last_px = self.trial.now.distance_px
        self._hardly_nearer = self.trial.now.distance_px > HARDLY_NEARER * before_px
        if not self.trial.filter.lost.any():
            self.confidence = min(1.0, self.LONGER * self.confidence)
        else:
            self.confidence *= self.SHORTER
            yield from self.trial.go_back()

    def _look(self) -> Motions:
        """Looks again where all that is left of the distance may be noise.

        It may be where a step ends hardly nearer than the one before and nobody knows how noisy points are.
        """
        noise = self.trial.filter.noise
        stalled = self._doubting and self.trial.now.distance_px > HARDLY_NEARER * self._last_px
        for _ in range(self.LOOKS):
            unknown = stalled and not noise.measured
            if not unknown and self.trial.now.distance_px > Gating.AGREE * noise.px:
                break
            yield from self.trial.move(np.zeros_like(self.trial.test_words))

    def _go(self, goal: Array) -> Motions:
        """Moves until motors stand at registers (m,), or no farther: a motion may have a greatest length."""
        words = goal - self.trial.now.registers
        left, going = np.ones_like(words), words != 0
        while going.any() and not self.trial.filter.lost.any():
            before = left
            yield from self.trial.move(np.where(going, goal - self.trial.now.registers, 0.0))
            left = (goal - self.trial.now.registers) / np.where(going, words, 1.0)
            going &= (left > self.UNFINISHED) & (left < before)

    def bounded(self, words: Array) -> Array:
        """The same direction (m,), as far as the predicted image motion allows."""
        moved = self.trial.estimator.predict(words)
        reach = min(self._step_px, self.trial.estimator.reach_px)
        shares = [
            1.0,
            reach / max(float(lengths_px(moved).max()), 1e-9),
            self._step_word / max(np.abs(words).max(), 1e-9),
        ]
        points = self.trial.now.points
        leaving = np.abs(points + moved) > np.maximum(self._border, np.abs(points))
        if leaving.any():
            room = np.maximum(self._border - np.sign(moved) * points, 0.0)[leaving]
            shares.append(max(self.LEAST_SHARE, float((room / np.abs(moved[leaving])).min())))
        return words * min(shares)
