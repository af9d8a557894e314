"""Which image points to believe: those near where they are predicted, or those that agree with each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calfree_gym.image import lengths_px

from ..base.observation import POINTS, Array, Flags, Observation


class Estimate(NamedTuple):
    """Points as they are estimated.

    Attributes:
        points: (4, 2); where nothing can be trusted, as predicted.
        found: Which of them (4,) were seen and trusted.
        inconsistent: Which of them (4,) were trusted although they are not where they were predicted.
    """

    points: Array
    found: Flags
    inconsistent: Flags


class Gating:
    """Gates around predicted points; where too little is inside them, agreement of several observations.

    Attributes:
        mistakes: Whether mistaken points have been met: then gates are narrower, since observing again costs
            less than a mistake.
    """

    GATE_PX, UNKNOWN_GATE_PX, WARY_GATE_PX = 30.0, 50.0, 15.0
    """Largest distance from its prediction at which a point is trusted: after a motion that J predicts, after
    any other motion, and, once mistaken points were met, after a motion that J predicts. Tuned on wild worlds
    3000 and up, without and with 20-40 % mistaken points."""
    GATE_SHARE = 0.6
    """The gate grows by this share of the predicted displacement: tuned likewise."""
    NOISES = 4.0
    """The gate grows by this many standard deviations of the noise. Derived: noise in two coordinates is
    longer once in exp(4² / 2), some 3,000 cases."""
    AGREE_PX = 6.0
    """Points of two observations agree within this, or within `NOISES` of their difference: tuned in a
    small simulation that is not in this repository, where two that agreed within 6 px were right in 99.6 % of
    the cases at 40 % mistaken points."""
    MISTAKEN = 2.0
    """A point was mistaken that is off by this many times what agreement allows: tuned likewise."""

    def __init__(self) -> None:
        self.mistakes = False

    def radii(self, predicted_px: Array, known: Flags) -> Array:
        """Radii (4,) in pixels of the gates around predicted points, in clear images.

        Args:
            predicted_px: Predicted displacements (4,).
            known: For which points (4,) the prediction rests on motions like this one.
        """
        near = self.WARY_GATE_PX if self.mistakes else self.GATE_PX
        return np.where(known, near, self.UNKNOWN_GATE_PX) + self.GATE_SHARE * predicted_px

    def estimate(
        self, observations: Sequence[Observation], predicted: Array, radii: Array, noise_px: float
    ) -> Estimate:
        """The points (4, 2) that observations at one place, one or several, give reason to believe."""
        radii = radii + self.NOISES * noise_px
        if len(observations) == 1:
            seen = observations[0].points
            found = observations[0].visible & (lengths_px(seen - predicted) <= radii)
            return Estimate(np.where(found[:, None], seen, predicted), found, np.zeros(POINTS, bool))
        estimate = Estimate(predicted.copy(), np.zeros(POINTS, bool), np.zeros(POINTS, bool))
        for i in range(POINTS):
            seen = np.array([each.points[i] for each in observations if each.visible[i]]).reshape(-1, 2)
            self._estimate_point(i, seen, predicted[i], radii[i], noise_px, estimate)
        return estimate

    def _estimate_point(
        self, i: int, seen: Array, predicted: Array, radius: float, noise_px: float, estimate: Estimate
    ) -> None:
        """Writes point i into the estimate: what was seen (k, 2) inside the gate, or agrees."""
        agree = max(self.AGREE_PX, self.NOISES * np.sqrt(2) * noise_px)
        inside = seen[lengths_px(seen - predicted) <= radius]
        if len(inside):
            estimate.points[i], estimate.found[i] = np.median(inside, 0), True
        elif len(seen) > 1:
            agreeing = lengths_px(seen[:, None] - seen[None]) <= agree
            best = agreeing.sum(1).argmax()
            if agreeing[best].sum() > 1:
                estimate.points[i] = seen[agreeing[best]].mean(0)
                estimate.found[i] = estimate.inconsistent[i] = True
        if estimate.found[i]:
            self.mistakes |= bool((lengths_px(seen - estimate.points[i]) > self.MISTAKEN * agree).any())
