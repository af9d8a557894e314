"""Rank-one updates: the least change of J that explains the last motion."""

from __future__ import annotations

import numpy as np

from agents.base.observation import Array, Flags
from agents.jacobian.estimator import Estimator


class Broyden(Estimator):
    """The least change that explains the last motion (Broyden's rank-one update; Hosoda & Asada 1994)."""

    REGULARISATION = 1e-6

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, words) / (self.REGULARISATION + words @ words)
        return self._as_seen(words, moved, seen)


class TrustRegion(Broyden):
    """Broyden's, with steps as long as its predictions have held (Jägersand 1997)."""

    LEAST_PX, MOST_PX = 16.0, 240.0

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self.reach_px = 100.0

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if self.jacobian.any(0).all() and moved[seen].any():
            missed = np.linalg.norm((moved - self.jacobian @ words)[seen]) / np.linalg.norm(moved[seen])
            change = 2.0 if missed < 0.3 else 0.5 if missed > 0.8 else 1.0
            self.reach_px = float(np.clip(change * self.reach_px, self.LEAST_PX, self.MOST_PX))
        return super()._learn(words, moved, seen)
