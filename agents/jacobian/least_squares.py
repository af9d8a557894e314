"""Least squares over all motions of a trial, recent or near ones counting more."""

from __future__ import annotations

import numpy as np

from agents.base.observation import Array, Flags
from agents.base.robust import cauchy_weights
from agents.jacobian.estimator import UNKNOWN_VARIANCE, Estimator
from calfree_gym.image import IMAGE_UNIT


class RecursiveLeastSquares(Estimator):
    """Least squares over all motions, older ones counting less and less (Piepmeier et al. 1999)."""

    FORGETTING = 0.5
    NOISE = 1e-4

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self._covariance = np.eye(motors) * (UNKNOWN_VARIANCE if start is None else 0.05)

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        older = self._covariance / self.FORGETTING
        gain = older @ words / (self.NOISE + words @ older @ words)
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, gain)
        updated = older - np.outer(gain, words @ older)
        self._covariance = updated * min(1.0, UNKNOWN_VARIANCE * len(words) / np.trace(updated))
        return self._as_seen(words, moved, seen)

    def forget(self, deviation: float = 2.0) -> None:
        """See `Estimator`."""
        self._covariance = np.eye(len(self._covariance)) * UNKNOWN_VARIANCE


class LocalLeastSquares(Estimator):
    """Least squares over stored motions, nearer ones counting more (Farahmand et al. 2007).

    Residuals are weighed once more (IRLS), so that a motion whose points were mistaken counts little
    (Shademan et al. 2010).
    """

    WIDTH = 0.3
    PRIOR = 1e-3
    ROBUST_PX = 20.0

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self.forget()

    def forget(self, deviation: float = 2.0) -> None:
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
        noise = (2 * IMAGE_UNIT / self.WIDTH) ** 2 / 10 + (self._sent**2).sum(1) / 2
        near = (1 / ((far + 0.01) * noise))[:, None] * self._looks
        weights = near
        for _ in range(3):
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
