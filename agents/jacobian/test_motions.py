"""Test motions: each measures one column, and is soon forgotten (section 3.2)."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array, Flags
from .estimator import Estimator


class TestMotions(Estimator):
    """The paper's: a motion of one motor by a word measures its column, displacement by word."""

    __test__ = False  # of no interest to pytest
    lasting = False

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if np.count_nonzero(words) == 1:
            motor = int(np.flatnonzero(words)[0])
            self.jacobian[seen, motor] = moved[seen] / words[motor]
        return self._as_seen(words, moved, seen)
