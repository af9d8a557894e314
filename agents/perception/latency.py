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

    STILL_PX, STILL_NOISES = 1.5, 2.0
    """A point has not moved if it moved by less than the first plus the second times the standard deviation
    of the noise. Derived: at the 0.7 px of a good marker that is three standard deviations of a
    difference."""
    CLEARLY, LATER = 1.8, 1.5
    """If two points moved by more than the first times that limit, the observation came in time. If two move
    by more than the second times it without a motion, it came late. Tuned on wild worlds 3000 and up, with
    and without latency."""
    FAR = 4.0
    """A motion can only be missed where it was predicted to be this many times that limit: tuned likewise."""
    LARGE_PX, LARGE_NOISES = 6.0, 8.0
    """A displacement is large enough to tell whether it came, beyond this: tuned likewise."""
    ARRIVED = 0.8
    """A point that is off by this share of its predicted displacement has not moved yet (1: not at all):
    tuned likewise."""
    NOISY_PX = 3.0
    """In more noise nothing can be told from one observation: tuned, as `NoiseEstimate.NOISY_PX`."""

    def __init__(self) -> None:
        self.motions = 0
        self.confirmed = False

    def in_time(self, predicted_px: Array, off_px: Array, noise_px: float) -> bool:
        """Whether an observation shows what a motion did.

        Args:
            predicted_px: Predicted displacement of each point (4,).
            off_px: How far each is from where it was predicted (4,).
            noise_px: Standard deviation of an image coordinate.
        """
        farthest = predicted_px.argmax()
        small = predicted_px[farthest] < self.LARGE_PX + self.LARGE_NOISES * noise_px
        return bool(small or off_px[farthest] < self.ARRIVED * predicted_px[farthest])

    def wait(
        self, observation: Observation, before: Array, predicted_px: Array, noise_px: float
    ) -> Generator[Array, Observation, list[Observation]]:
        """Observes again (zero words) until the points can show the motion.

        Args:
            observation: The first one after the motion.
            before: Points before it (4, 2).
            predicted_px: Predicted displacement of each point (4,); NaN where none is known.
            noise_px: Standard deviation of an image coordinate.

        Returns:
            One observation, or two at the same place.
        """
        still = np.zeros_like(observation.registers)
        for _ in range(self.motions):
            observation = yield still
        if noise_px > self.NOISY_PX or not observation.visible.any():
            return [observation]
        limit = self.STILL_PX + self.STILL_NOISES * noise_px
        moved = np.where(observation.visible, lengths_px(observation.points - before), 0.0)
        if np.count_nonzero(moved > self.CLEARLY * limit) > 1:
            self.confirmed = True
        elif not self.confirmed or moved.max() < limit < np.nanmax(predicted_px, initial=0.0) / self.FAR:
            later = yield still
            more = (lengths_px(later.points - observation.points) > self.LATER * limit) | ~later.visible
            if np.count_nonzero(more & observation.visible) > 1:
                self.motions += 1
                return [later]
            self.confirmed |= bool(moved.max() > limit)
            return [observation, later]
        return [observation]
