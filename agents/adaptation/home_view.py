"""The gripper's view at home: once a trial, for nothing, the same point is seen again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.base.observation import Array
from agents.jacobian.estimator import MARKER_NOISE_PX as NOISE_PX
from calfree_gym.image import IMAGE_UNIT

Cameras = NDArray[np.bool_]
"""Which of the two cameras (2,)."""

SIGMAS = 5.0
"""What differs by so many standard deviations has changed."""


class HomeView:
    """Where the gripper was seen at home, trial after trial, since the cameras were last known to change.

    Attributes:
        seen: Sensor vectors (n, 4), the latest last.
        steps: From each of the latest looks to the next (n, 4), whatever changed between: what noise is.
    """

    KEPT = 40
    LATEST = 8
    """A displacement is looked for in the means of so many of the latest looks, and fewer."""
    FEW = 4
    """A jump is looked for against so many: few enough that a drift is none."""
    USUAL = 12
    """Looks by which noise is believed to be usual before it is known."""
    NORMAL_MEDIAN = 0.6745

    def __init__(self, seen: Array | None = None, steps: Array | None = None) -> None:
        self.seen = np.empty((0, 4)) if seen is None else seen
        self.steps = np.empty((0, 4)) if steps is None else steps

    def add(self, gripper: Array) -> None:
        """Takes in where the gripper (4,) is seen now."""
        self.steps = np.concatenate([self.steps, np.abs(gripper - self.seen[-1:])])[-self.KEPT :]
        self.seen = np.concatenate([self.seen, [gripper]])[-self.KEPT :]

    def keep(self, latest: int) -> None:
        """Forgets all but the latest looks."""
        self.seen = self.seen[len(self.seen) - latest :]

    def noise_px(self) -> float:
        """Standard deviation of a coordinate, from one look to the next."""
        steps = self.steps.ravel() / (np.sqrt(2) * IMAGE_UNIT)
        usual = np.full(self.USUAL, self.NORMAL_MEDIAN * NOISE_PX)
        return float(np.median(np.concatenate([steps, usual]))) / self.NORMAL_MEDIAN

    def jumped(self, gripper: Array) -> Cameras:
        """In which cameras the gripper is now seen elsewhere than in the last few trials."""
        return self._displaced(np.concatenate([self.seen[-self.FEW :], [gripper]]), 1)

    def drifting(self) -> Cameras:
        """In which cameras the latest looks are elsewhere than those before."""
        for latest in range(2, min(self.LATEST, len(self.seen) - 1) + 1):
            cameras = self._displaced(self.seen, latest)
            if cameras.any():
                return cameras
        return np.zeros(2, bool)

    def rate(self, latest: int) -> Array:
        """How far the view goes each trial (4,), by the latest looks."""
        seen = self.seen[-latest:]
        times = np.arange(len(seen)) - (len(seen) - 1) / 2
        return np.asarray(times @ seen / max(float(times @ times), 1.0))

    def _displaced(self, seen: Array, latest: int) -> Cameras:
        if len(seen) == latest:
            return np.zeros(2, bool)
        apart = seen[-latest:].mean(0) - seen[:-latest].mean(0)
        noise = self.noise_px() * np.sqrt(1 / latest + 1 / (len(seen) - latest))
        return np.asarray(lengths_px(apart) > SIGMAS * noise)


def lengths_px(sensors: Array) -> Array:
    """Lengths (..., 2), in each camera and in pixels, of differences of sensor vectors (..., 4)."""
    return np.asarray(np.hypot(sensors[..., ::2], sensors[..., 1::2]) / IMAGE_UNIT)
