"""What was seen of gripper and object, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.entries import Entries
from ..base.observation import Array, Observation, camera_lengths_px
from ..servo.perception import MARKER_NOISE_PX, NoiseEstimate


@dataclass(frozen=True)
class Pairs(Entries):
    """Registers and what is seen there; each gripper point in both images.

    Attributes:
        registers: Registers (n, m).
        sensors: Sensor vectors (n, 4) of the gripper there, in image units.
        objects: Sensor vectors (n, 4) of the object there; NaN where it was not seen in both images, then or
            at home: nobody knows which object it is.
        homes: Sensor vectors (n, 4) of the object at home, in the same trial.
        noise_px: Standard deviation (n,) of an image coordinate, as far as known in that trial.
        trials: The trial (n,) of each, counted from 0.
    """

    registers: Array
    sensors: Array
    objects: Array
    homes: Array
    noise_px: Array
    trials: NDArray[np.int64]

    @classmethod
    def none(cls, motors: int) -> Self:
        """No pairs, for that number of registers."""
        nothing = np.empty((0, 4))
        return cls(np.empty((0, motors)), nothing, nothing, nothing, np.empty(0), np.empty(0, np.int64))

    @classmethod
    def of_trial(cls, looks: Sequence[Observation], noise_px: float, trial: int) -> Self:
        """The looks of a trial that show the gripper in both images.

        Args:
            looks: What was observed, at home first.
            noise_px: Standard deviation of an image coordinate.
            trial: The trial's number.
        """
        first = looks[0]
        looks = [look for look in looks if look.shows_gripper]
        shown = [first.shows_object and look.shows_object for look in looks]
        count = len(looks)
        if not count:
            return cls.none(0)
        return cls(
            np.array([look.registers for look in looks]),
            np.array([look.gripper for look in looks]).reshape(count, 4),
            np.array(
                [look.object if seen else np.full(4, np.nan) for look, seen in zip(looks, shown, strict=True)]
            ).reshape(count, 4),
            np.tile(first.object, (count, 1)),
            np.full(count, noise_px),
            np.full(count, trial),
        )

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """From what `arrays` returned.

        Raises:
            ValueError: An array is missing, or of another shape than the others.
        """
        registers = checked_array(arrays, "registers", (None, None))
        count = len(registers)
        sensors, homes = (checked_array(arrays, name, (count, 4)) for name in ("sensors", "homes"))
        objects = checked_array(arrays, "objects", (count, 4), allow_nan=True)
        noise_px, trials = (checked_array(arrays, name, (count,)) for name in ("noise_px", "trials"))
        return cls(registers, sensors, objects, homes, noise_px, trials.astype(np.int64))

    @property
    def with_object(self) -> NDArray[np.bool_]:
        """Which of them (n,) show the object in both images."""
        return np.asarray(np.isfinite(self.objects).all(1))

    def without_objects(self) -> Pairs:
        """The same, as if the object had not been seen."""
        return replace(self, objects=np.full_like(self.objects, np.nan))

    def away(self) -> Pairs:
        """All but the first, in a trial that begins at home."""
        return self.only(np.arange(len(self)) > 0)

    def latest(self, trials: int) -> Pairs:
        """Those of that number of latest trials."""
        return self.only(self.trials > self.trials.max(initial=0) - trials)


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
