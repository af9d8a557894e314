"""The gripper's view at home: every trial shows the same point again, at no cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..base.observation import Array, camera_lengths_px
from ..perception.noise import MARKER_NOISE_PX, NoiseEstimate

Cameras = NDArray[np.bool_]
"""Which of the two cameras (2,): left, right."""


class HomeView:
    """Where the gripper was seen at home, trial after trial, since the cameras were last known to change.

    Attributes:
        sensors: Sensor vectors (n, 4) in image units, the latest last.
        trials: The trial (n,) of each.
        noise_px: Standard deviation of an image coordinate, as it was known in the last trial.
    """

    SIGMAS = 5.0
    """A displacement of this many standard deviations is a change. Derived: noise in two coordinates is
    longer in exp(-5²/2), 4 of a million cases; the margin is there because the noise itself is estimated."""
    KEPT = 40
    """Trials that are kept (a guard: drifts need fewer)."""
    DRIFT_LATEST = 8
    """A drift is looked for in the means of at most this many of the latest trials. Tuned (wild worlds
    3000-)."""
    JUMP_REFERENCE = 4
    """A jump is looked for against the mean of this many trials: few, so that a slow drift is no jump. Tuned
    (wild worlds 3000-)."""

    def __init__(self) -> None:
        self.sensors = np.empty((0, 4))
        self.trials = np.empty(0, np.int64)
        self.noise_px = MARKER_NOISE_PX

    def add(self, gripper: Array, noise_px: float, trial: int) -> None:
        """Takes in where the gripper (4,) is seen in this trial, and how noisily."""
        self.sensors = np.concatenate([self.sensors, [gripper]])[-self.KEPT :]
        self.trials = np.append(self.trials, trial)[-self.KEPT :]
        self.noise_px = noise_px

    def keep_since(self, trial: int) -> None:
        """Forgets what was seen before that trial."""
        since = self.trials >= trial
        self.sensors, self.trials = self.sensors[since], self.trials[since]

    def reference(self) -> Array:
        """Where the gripper should be seen (4,): the mean of the last few trials."""
        return np.asarray(self.sensors[-self.JUMP_REFERENCE :].mean(0))

    def before(self, trial: int) -> Array:
        """Where the gripper was seen (4,) before that trial: a mean; NaN where it was not."""
        earlier = self.sensors[self.trials < trial]
        return np.asarray(earlier.mean(0)) if len(earlier) else np.full(4, np.nan)

    def jumped(self, gripper: Array) -> Cameras:
        """In which cameras the gripper (4,) is now seen elsewhere than in the last few trials."""
        sensors = np.concatenate([self.sensors[-self.JUMP_REFERENCE :], [gripper]])
        return self._displaced(sensors, np.array([1]))[0] if len(sensors) > 1 else np.zeros(2, bool)

    def drifting(self) -> Cameras:
        """In which cameras the latest trials show the gripper elsewhere than those before."""
        latest = np.arange(2, min(self.DRIFT_LATEST, len(self.sensors) - 1) + 1)
        displaced = self._displaced(self.sensors, latest)
        return displaced[displaced.any(1).argmax()] if len(latest) else np.zeros(2, bool)

    def drift_rate(self, latest: int) -> Array:
        """How far the view moves per trial (4,): the slope of a line through the latest trials."""
        sensors, trials = self.sensors[-latest:], self.trials[-latest:]
        times = trials - trials.mean()
        return np.asarray(times @ sensors / max(float(times @ times), 1.0))

    @property
    def _least_px(self) -> float:
        """A displacement of this length is a change, where both views are single and equally noisy.

        As long as too few trials have told of noise, more of it is assumed. Then, by n numbers, a length of
        noise is to its estimate as F(2, n) has it: one that is as rare as `SIGMAS` are where noise is known.
        """
        numbers = self.sensors[1:].size
        if numbers < NoiseEstimate.ENOUGH:
            return self.SIGMAS * max(self.noise_px, NoiseEstimate.NOISY_PX)
        return self.noise_px * float(np.sqrt(numbers * np.expm1(self.SIGMAS**2 / numbers)))

    def _displaced(self, sensors: Array, latest: NDArray[np.int64]) -> Cameras:
        """In which cameras (k, 2) the means of the latest (k,) differ from the means of those before."""
        after, before = latest[:, None], len(sensors) - latest[:, None]
        sums = sensors.cumsum(0)
        earlier = sums[-latest - 1]
        apart = (sums[-1] - earlier) / after - earlier / before
        return np.asarray(camera_lengths_px(apart) > self._least_px * np.sqrt(1 / after + 1 / before))
