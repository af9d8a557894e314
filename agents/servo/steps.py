"""Steps: how far a motion may go by what is known of the Jacobian, and the way back where it lost a point."""

from __future__ import annotations

import numpy as np

from agents.base.agent import Array
from agents.jacobian import both_points, displacement_px
from agents.servo.trial import Motions, Trial


class Steps:
    """The steps of one trial.

    Args:
        trial: The trial.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        border: Steps are predicted to keep every point within this part of the images.
    """

    SHORTER, LONGER = 0.4, 1.5

    def __init__(self, trial: Trial, step_px: float, step_word: float, border: float) -> None:
        self.trial = trial
        self.confidence = 1.0
        self._step_px = step_px
        self._step_word = step_word
        self._border = border

    def make(self, words: Array) -> Motions:
        """Executes words (m,) as far as they may go; where a point got lost, goes back, and then shorter."""
        yield from self.trial.move(self.confidence * self.bounded(words))
        if not self.trial.senses.lost.any():
            self.confidence = min(1.0, self.LONGER * self.confidence)
        else:
            self.confidence *= self.SHORTER
            yield from self.trial.go_back()

    def bounded(self, words: Array) -> Array:
        """The same direction (m,), as far as the predicted image motion allows."""
        jacobian = self.trial.estimator.jacobian
        moved = jacobian @ words
        reach = min(self._step_px, self.trial.estimator.reach_px)
        shares = [
            1.0,
            reach / max(displacement_px(moved), 1e-9),
            self._step_word / max(np.abs(words).max(), 1e-9),
        ]
        points = both_points(self.trial.look)
        leaving = np.abs(points + moved) > np.maximum(self._border, np.abs(points))
        if leaving.any():
            room = np.maximum(self._border - np.sign(moved) * points, 0.0)[leaving]
            shares.append(max(0.1, float((room / np.abs(moved[leaving])).min())))
        return words * min(shares)
