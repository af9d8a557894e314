"""Rank-one updates: the least change of J that explains the last motion."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array, Flags
from .estimator import Estimator
from .slopes import Slopes


class Broyden(Estimator):
    """The least change that explains the last motion (Broyden's rank-one update; Hosoda & Asada 1994)."""

    REGULARISATION = 1e-6
    """Of |c|² (a guard): a thousandth of a word moves nothing that could be learned from."""

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, words) / (self.REGULARISATION + words @ words)
        return self._as_seen(words, moved, seen)


class TrustRegion(Broyden):
    """Broyden's, with steps as long as its predictions have held (Jägersand 1997)."""

    START_PX = 100.0
    """Length of the first steps: tuned on wild worlds 3000 and up."""
    LEAST_PX, MOST_PX = 16.0, 240.0
    """Lengths of all steps: tuned likewise."""
    HELD, MISSED = 0.3, 0.8
    """A prediction held, and did not, that missed by less, and by more, than this share of what was seen:
    tuned likewise."""
    LONGER, SHORTER = 2.0, 0.5
    """Steps get longer and shorter by these factors. Source: usual for trust regions (Dennis & Schnabel
    1983)."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self.reach_px = self.START_PX

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if words.any() and self.jacobian.any(0).all() and moved[seen].any():
            missed = np.linalg.norm((moved - self.jacobian @ words)[seen]) / np.linalg.norm(moved[seen])
            change = self.LONGER if missed < self.HELD else self.SHORTER if missed > self.MISSED else 1.0
            self.reach_px = float(np.clip(change * self.reach_px, self.LEAST_PX, self.MOST_PX))
        return super()._learn(words, moved, seen)
