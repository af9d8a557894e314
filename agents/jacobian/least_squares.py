"""Least squares over all motions of a trial, recent or near ones counting more."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, Flags
from ..base.robust import cauchy_weights
from .estimator import SIGN_CHANGE, UNKNOWN_VARIANCE, Estimator
from .slopes import Slopes


class RecursiveLeastSquares(Estimator):
    """Least squares over all motions, older ones counting less and less (Piepmeier et al. 1999)."""

    FORGETTING = 0.5
    """A motion counts so much less with each that follows it: tuned on wild worlds 3000 and up."""
    NOISE = 1e-4
    """Variance of a displacement, in square image units, (2.6 px)²: tuned likewise."""
    START_VARIANCE = 0.05
    """Of the entries of a Jacobian from an earlier trial, in (image units by word)²: tuned likewise."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self._covariance = np.eye(motors) * (UNKNOWN_VARIANCE if start is None else self.START_VARIANCE)

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if not words.any():
            return self._as_seen(words, moved, seen)
        older = self._covariance / self.FORGETTING
        gain = older @ words / (self.NOISE + words @ older @ words)
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, gain)
        updated = older - np.outer(gain, words @ older)
        self._covariance = updated * min(1.0, UNKNOWN_VARIANCE * len(words) / np.trace(updated))
        return self._as_seen(words, moved, seen)

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        """See `Estimator`."""
        self._covariance = np.eye(len(self._covariance)) * UNKNOWN_VARIANCE


class LocalLeastSquares(Estimator):
    """Least squares over stored motions, nearer ones counting more (Farahmand et al. 2007).

    Residuals are weighed once more (IRLS), so that a motion whose points were mistaken counts little
    (Shademan et al. 2010).
    """

    WIDTH = 0.3
    """Distances of motions, in registers, are divided by this; their weight goes with the inverse square:
    tuned on wild worlds 3000 and up."""
    NEAR = 0.01
    """Added to that square: within a tenth (√0.01) of `WIDTH` motions weigh about alike. Tuned likewise."""
    NOISE_PX, NOISE_PARTS = 2.0, 10.0
    """Variance of a slope by noise: of this many pixels by `WIDTH`, squared and divided by that. Tuned
    likewise."""
    LENGTH_PARTS = 2.0
    """Variance of a slope by what a line misses: the square of the word, divided by that. Tuned likewise."""
    PRIOR = 1e-3
    """Weight of the Jacobian that it begins with: tuned likewise."""
    ROBUST_PX = 20.0
    """A motion missed by that much counts half: tuned likewise."""
    PASSES = 3
    """So often residuals are weighed anew. Source: a few passes of IRLS are usual (Holland & Welsch 1977)."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self.forget()

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        """See `Estimator`."""
        motors = self.jacobian.shape[1]
        self._prior = self.jacobian.copy()
        self._middles, self._sent = np.empty((2, 0, motors))
        self._moves, self._looks = np.empty((2, 0, 8))

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        self._middles = np.concatenate([self._middles - words, [-words / 2]])
        self._sent = np.concatenate([self._sent, [words]])
        self._moves = np.concatenate([self._moves, [moved]])
        self._looks = np.concatenate([self._looks, [seen]])
        far = (self._middles**2).sum(1) / self.WIDTH**2
        still = (self.NOISE_PX * IMAGE_UNIT / self.WIDTH) ** 2 / self.NOISE_PARTS
        noise = still + (self._sent**2).sum(1) / self.LENGTH_PARTS
        near = (1 / ((far + self.NEAR) * noise))[:, None] * self._looks
        weights = near
        for _ in range(self.PASSES):
            self.jacobian = self._fit(weights)
            residual = self._moves - self._sent @ self.jacobian.T
            weights = near * cauchy_weights(residual / (self.ROBUST_PX * IMAGE_UNIT))
        return self._as_seen(words, moved, seen)

    def _fit(self, weights: Array) -> Array:
        """The Jacobian (8, m) of least squares by weights (motions, 8), all rows at once."""
        count, motors = self._sent.shape
        squares = (self._sent[:, :, None] * self._sent[:, None]).reshape(count, -1)
        normal = (weights.T @ squares).reshape(-1, motors, motors) + self.PRIOR * np.eye(motors)
        jt_w = (weights * self._moves).T @ self._sent + self.PRIOR * self._prior
        return np.asarray(np.linalg.solve(normal, jt_w[:, :, None])[:, :, 0])
