"""Which image points to believe: those near where they are expected, or those that agree with each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calfree_gym.image import IMAGE_SIZE, lengths_px

from ..base.observation import POINTS, Array, Flags, Observation


class Estimate(NamedTuple):
    """Points as they are estimated.

    Attributes:
        points: (4, 2); where nothing can be trusted, as expected.
        found: Which of them (4,) were seen and trusted.
        inconsistent: Which of them (4,) were trusted although they are not where they were expected.
    """

    points: Array
    found: Flags
    inconsistent: Flags


class Gating:
    """Gates around expected points; where too little is inside them, agreement of several observations.

    A gate ends where a point is as likely to be mistaken, and so anywhere in the image, as to be seen right.

    Attributes:
        counts: How many points were mistaken, of how many (2,), with what is taken for granted beforehand.
    """

    TAILS = 4.0
    """Degrees of freedom of Student's t distribution, in two coordinates, of what is expected: derived, of a
    servo's expectations 5 % miss by more than 4 deviations and 1 % by more than 6 to 9."""
    AGREE = 4.0
    """Points of two observations agree within this many standard deviations of their difference. Derived:
    noise in two coordinates is longer once in exp(4² / 2), some 3,000 cases."""
    MISTAKEN, OF = 1.0, 100.0
    """Beforehand so many of so many points are mistaken. Choice: a hundred looks outweigh it."""

    def __init__(self) -> None:
        self.counts = np.array([self.MISTAKEN, self.OF])

    @property
    def mistaken(self) -> float:
        """The share of points that are mistaken, as far as known."""
        return float(self.counts[0] / self.counts[1])

    def radii(self, deviations_px: Array, noise_px: float) -> Array:
        """Radii (4,) in pixels of the gates around expected points.

        Args:
            deviations_px: Of the coordinates of the points that are expected (4,).
            noise_px: Standard deviation of an image coordinate.
        """
        squares = np.square(deviations_px) + noise_px**2
        odds = self.mistaken / (1 - self.mistaken)
        highest = IMAGE_SIZE**2 / (2 * np.pi * squares * odds)
        power = 2 / (self.TAILS + 2)
        return np.sqrt(self.TAILS * squares * np.maximum(highest**power - 1, 0))

    def estimate(
        self, observations: Sequence[Observation], expected: Array, radii: Array, noise_px: float
    ) -> Estimate:
        """The points (4, 2) that observations at one place, one or several, give reason to believe."""
        if len(observations) == 1:
            seen = observations[0].points
            found = observations[0].visible & (lengths_px(seen - expected) <= radii)
            return Estimate(np.where(found[:, None], seen, expected), found, np.zeros(POINTS, bool))
        estimate = Estimate(expected.copy(), np.zeros(POINTS, bool), np.zeros(POINTS, bool))
        for i in range(POINTS):
            seen = np.array([each.points[i] for each in observations if each.visible[i]]).reshape(-1, 2)
            self._estimate_point(i, seen, expected[i], radii[i], noise_px, estimate)
        return estimate

    def count(self, observations: Sequence[Observation], estimate: Estimate, noise_px: float) -> None:
        """Learns from observations at one place how many points are mistaken."""
        for each in observations:
            told = each.visible & estimate.found
            wrong = lengths_px(each.points - estimate.points)[told] > self._agree_px(noise_px)
            self.counts = self.counts + np.array([np.count_nonzero(wrong), len(wrong)])

    def _agree_px(self, noise_px: float) -> float:
        return self.AGREE * np.sqrt(2) * noise_px

    def _estimate_point(
        self, i: int, seen: Array, expected: Array, radius: float, noise_px: float, estimate: Estimate
    ) -> None:
        """Writes point i into the estimate: what was seen (k, 2) inside the gate, or agrees."""
        inside = seen[lengths_px(seen - expected) <= radius]
        if len(inside):
            estimate.points[i], estimate.found[i] = np.median(inside, 0), True
        elif len(seen) > 1:
            agreeing = lengths_px(seen[:, None] - seen[None]) <= self._agree_px(noise_px)
            best = agreeing.sum(1).argmax()
            if agreeing[best].sum() > 1:
                estimate.points[i] = seen[agreeing[best]].mean(0)
                estimate.found[i] = estimate.inconsistent[i] = True
