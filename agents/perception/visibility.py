"""Which points are out of view, and which are only missing for a moment."""

from __future__ import annotations

import numpy as np

from ..base.observation import POINTS, Flags


class Visibility:
    """For how long points have not been seen.

    Attributes:
        gaps: Whether a point has come or gone without a motion: points are missing at times.
    """

    PATIENCE = 4
    """Where points are missing at times, one that was not seen in more observations is lost. Derived: with
    30 % missing that is a mistake in 0.3⁵ = 0.2 % of the cases."""

    def __init__(self) -> None:
        self.gaps = False
        self._unseen = np.zeros(POINTS, int)

    def add(self, visible: Flags) -> None:
        """Takes in which points (4,) are seen now."""
        self._unseen = np.where(visible, 0, self._unseen + 1)

    @property
    def lost(self) -> Flags:
        """Which points (4,) have not been seen for so long that they must be out of view."""
        return self._unseen > (self.PATIENCE if self.gaps else 1)
