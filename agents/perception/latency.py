"""By how many motions image points come late, learned from motions that seem to have done nothing."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from calfree_gym.image import lengths_px

from ..base.observation import Array, Observation


class LatencyEstimate:
    """By how many motions observations come late.

    Attributes:
        motions: The estimate.
        confirmed: Whether a motion has been seen to come in time.
    """

    STILL = 4.0
    """Points have moved whose squared displacements are so many standard deviations above those of noise.
    Derived: that is noise once in some 500 cases (chi square)."""

    def __init__(self) -> None:
        self.motions = 0
        self.confirmed = False

    def wait(
        self, observation: Observation, before: Array, surely_px: Array, noise_px: float
    ) -> Generator[Array, Observation, list[Observation]]:
        """Observes again (zero words) until the points can show the motion.

        Args:
            observation: The first one after the motion.
            before: Points before it (4, 2).
            surely_px: How far each point (4,) must have moved at least.
            noise_px: Standard deviation of an image coordinate.

        Returns:
            One observation, or two at the same place.
        """
        still = np.zeros_like(observation.registers)
        for _ in range(self.motions):
            observation = yield still
        if not observation.visible.any():
            return [observation]
        before_px = lengths_px(observation.points - before)[observation.visible]
        if self._moved(before_px, noise_px):
            self.confirmed = True
        elif not self.confirmed or surely_px.max() > 0:
            later = yield still
            both = observation.visible & later.visible
            since_px = lengths_px(later.points - observation.points)[both]
            if sum(self._moved(each, noise_px) for each in since_px[:, None]) > 1:
                self.motions += 1
                return [later]
            return [observation, later]
        return [observation]

    def _moved(self, displacements_px: Array, noise_px: float) -> bool:
        """Whether points (n,) moved by more than noise would have it, all together."""
        squares = np.square(displacements_px) / (2 * noise_px**2)
        freedom = 2 * len(squares)
        return bool(squares.sum() > freedom + self.STILL * np.sqrt(2 * freedom))
