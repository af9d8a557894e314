"""A Kalman filter on points and Jacobian."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, Flags
from .estimator import SIGN_CHANGE, UNKNOWN_VARIANCE, Estimator
from .slopes import Slopes


class Kalman(Estimator):
    """A Kalman filter on points and Jacobian, which wander as the arm moves (after Qian & Su 2002).

    The state of an image point are the rows (p, J) of its two coordinates, which share one covariance
    (1 + m, 1 + m): a motion moves p by J c, and then p is seen, or is not. The random walk of a column grows
    with its length and with how far the arm went; that of p is a share of its displacement, for the curve
    that a straight line leaves out. Where points are noisy, the filter averages observations at different
    places; where one is missing, it goes on by prediction. Where noise turns out larger than it was thought
    to be, so does the variance of all that was concluded.

    The default: where observations are clear all estimators that last need about as few motions
    (`configs/first-trials.yaml`); where image points are noisy only this one goes on reaching
    (`configs/estimators.yaml`).
    """

    bridging = True
    WANDERING = 0.2
    """A column wanders by this share of its length over a word of 1: tuned on wild worlds 3000 and up."""
    START_DEVIATION = 0.3
    """Standard deviation of the entries of a Jacobian from an earlier trial, in image units by word: tuned
    likewise."""
    CURVE = 0.02
    """A straight line misses by this share of a displacement: tuned likewise."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self._noise: float | None = None
        unsure = UNKNOWN_VARIANCE if start is None else self.START_DEVIATION**2
        diagonal = [(self.noise_px * IMAGE_UNIT) ** 2, *[unsure] * motors]
        self._covariance = np.tile(np.diag(diagonal), (4, 1, 1))
        self._transition = np.eye(1 + motors)
        self._columns = np.arange(1, 1 + motors)

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        noise = (self.noise_px * IMAGE_UNIT) ** 2
        if self._noise is None:
            self._covariance[:, 0, 0] = self._noise = noise
        expected = self.jacobian @ words
        self._transition[0, 1:] = words
        predicted = self._transition @ (self._covariance * (noise / self._noise)) @ self._transition.T
        self._noise = noise
        squares = expected * expected
        predicted[:, 0, 0] += self.CURVE**2 * (squares[::2] + squares[1::2])
        walk = self.WANDERING**2 * float(words @ words)
        predicted[:, self._columns, self._columns] += walk * self._squared_lengths()
        gain = predicted[:, 0] * (seen[::2] / (predicted[:, 0, 0] + noise))[:, None]
        self._covariance = predicted - gain[:, :, None] * predicted[:, :1]
        corrections = gain.repeat(2, 0) * (moved - expected)[:, None]
        self.jacobian += corrections[:, 1:]
        return np.asarray(expected + corrections[:, 0])

    def _squared_lengths(self) -> Array:
        """Mean square (m,) of what a word does to a point."""
        return np.einsum("ij,ij->j", self.jacobian, self.jacobian) / 4

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        """See `Estimator`."""
        self._covariance[:, self._columns, self._columns] += deviation**2 * self._squared_lengths()

    @property
    def blur_px(self) -> float:
        """See `Estimator`."""
        return float(np.sqrt(self._covariance[:, 0, 0].max())) / IMAGE_UNIT

    def deviations(self, words: Array) -> Array:
        """See `Estimator`."""
        return np.asarray(np.sqrt(self._covariance[:, self._columns, self._columns].max(0)))
