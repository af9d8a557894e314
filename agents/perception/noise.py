"""How noisy image points are, learned from observations at one place, and from one home to the next."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array

MARKER_NOISE_PX = 0.7
"""Noise of an image coordinate before any is known. Derived: the 0.5 px of a good marker, as in coarse
and wild worlds, and a margin of √2."""


class NoiseEstimate:
    """Standard deviation of an image coordinate, by differences between two observations of one place.

    A low quantile of the differences starts it, so that mistaken points hardly matter; then all that is
    within three standard deviations refines it.

    Every trial shows the gripper at home, which costs no motion. But from one trial to the next cameras can
    be moved, and then the difference is no noise. So it is by homes only as long as few places were observed
    twice in a row.

    Attributes:
        px: The estimate; that of a good marker until there are `ENOUGH` differences.
    """

    ENOUGH = 12
    """Differences of a coordinate. Derived: the estimate is then within 20 % (1 / √(2 · 12))."""
    LATEST = 320
    """This many differences are kept: forty re-observations of all four points (a guard)."""
    QUANTILE, QUANTILE_OF_NORMAL = 0.15, 0.189
    """This share of normal deviates is smaller than that. Derived: Φ⁻¹(0.575) = 0.189, and a share so small
    that 40 % mistaken points hardly move it."""
    WITHIN = 3.0
    """Differences within this many standard deviations refine the estimate. Source: usual in sigma
    clipping."""
    REFINEMENTS = 3
    """They do so this often (a guard: then it changes little)."""
    LEAST_PX, MOST_PX = 0.5, 40.0
    """Bounds (guards): no marker is known better than half a pixel, and beyond 40 px nothing is reached."""
    NOISY_PX = 3.0
    """Noise that is worth knowing well: tuned on wild worlds 3000 and up, at 20 px noise."""

    def __init__(self) -> None:
        self.px = MARKER_NOISE_PX
        self._at_once, self._of_homes = np.empty(0), np.empty(0)

    @property
    def measured(self) -> bool:
        """Whether enough points were seen twice in a row at one place."""
        return len(self._at_once) >= self.ENOUGH

    def add(self, difference: Array) -> None:
        """Learns from the difference (k, 2), in image units, of points seen twice in a row at one place."""
        self.restore(self._with(self._at_once, difference), self._of_homes)

    def add_homes(self, difference: Array) -> None:
        """Learns from the difference (k, 2), in image units, of points at home in two trials."""
        self.restore(self._at_once, self._with(self._of_homes, difference))

    def _with(self, differences: Array, new: Array) -> Array:
        return np.concatenate([differences, np.abs(new).ravel() / IMAGE_UNIT])[-self.LATEST :]

    def arrays(self) -> tuple[Array, Array]:
        """The differences (n,) that it is known by, in pixels: of observations in a row, and of homes."""
        return self._at_once, self._of_homes

    def restore(self, at_once: Array, of_homes: Array) -> None:
        """Estimates it by differences (n,) that are known."""
        self._at_once, self._of_homes = at_once, of_homes
        self.px = MARKER_NOISE_PX
        pool = (at_once if self.measured else of_homes) / np.sqrt(2)
        if len(pool) < self.ENOUGH:
            return
        noise = np.quantile(pool, self.QUANTILE) / self.QUANTILE_OF_NORMAL
        for _ in range(self.REFINEMENTS):
            near = pool[pool <= self.WITHIN * noise]
            noise = np.sqrt(near @ near / len(near))
        self.px = float(np.clip(noise, self.LEAST_PX, self.MOST_PX))
