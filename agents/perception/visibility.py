"""Which points are out of view, and which are only missing for a moment."""

from __future__ import annotations

import numpy as np

from ..base.observation import POINTS, Flags


class Visibility:
    """For how long points have not been seen.

    Attributes:
        gaps: Whether a point has come or gone without a motion: points are missing at times.
        returns: How many points that were not seen were seen in one more observation of the same place, and
            how many were not (2,).
        ever: Which points (4,) have been seen at all.
    """

    PATIENCE = 4
    """Where points are missing at times, one that was not seen in more observations is lost. Derived: with
    30 % missing that is a mistake in 0.3⁵ = 0.2 % of the cases."""

    WORTH = 0.3
    """One more observation of the same place is worth a motion where it shows a missing point so often.
    Choice: it costs one motion, and a wrong belief that a point is hidden costs about three."""

    def __init__(self) -> None:
        self.gaps = False
        self.returns = np.zeros(2)
        self.ever = np.zeros(POINTS, bool)
        self._unseen = np.zeros(POINTS, int)

    def add(self, visible: Flags, again: bool) -> None:
        """Takes in which points (4,) are seen now, and whether nothing has moved since the last time."""
        missing = self._unseen > 0
        if again:
            self.returns = self.returns + np.array([(missing & visible).sum(), (missing & ~visible).sum()])
            self.gaps |= bool((missing == visible).any())
        self.ever = self.ever | visible
        self._unseen = np.where(visible, 0, self._unseen + 1)

    @property
    def may_return(self) -> bool:
        """Whether one more observation may well show a missing point, by Laplace's rule of succession."""
        back, out = self.returns
        return bool((1 + back) / (2 + back + out) > self.WORTH)

    @property
    def lost(self) -> Flags:
        """Which points (4,) have not been seen for so long that they must be hidden, or out of view."""
        return self._unseen > (self.PATIENCE if self.gaps else int(self.may_return))
