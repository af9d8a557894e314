"""Has anything changed? The gripper's view at home tells, and what is seen elsewhere and was not expected."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array, camera_lengths_px
from ..base.storage import prefixed, under
from .pairs import Cameras, HomeView, Pairs
from .remembered import Remembered

NO_CAMERA = np.zeros(2, bool)
NO_CAMERA.flags.writeable = False
NOWHERE = np.full(4, np.nan)


class ChangeVerdict(Enum):
    """What one trial says about the world."""

    UNCHANGED = "unchanged"
    SUSPECT = "suspect"
    CHANGED = "changed"


@dataclass(frozen=True)
class Finding:
    """What the detector says after a trial.

    Attributes:
        verdict: Whether the world has changed; a suspicion waits for the next trials.
        pairs: CHANGED: all that shows the change. Else: what may be learned.
        cameras: CHANGED: in which cameras (2,) it shows.
        home_before: CHANGED: where the gripper was seen at home (4,) before.
        first: CHANGED: the first of `pairs` that shows it; those before it may be older than the change.
    """

    verdict: ChangeVerdict
    pairs: Pairs
    cameras: Cameras = field(default_factory=NO_CAMERA.copy)
    home_before: Array = field(default_factory=NOWHERE.copy)
    first: int = 0


class ChangeDetector:
    """Watches for jumps and for drift.

    A jump is accepted where home is seen elsewhere, and so is most of the rest of that trial, or home was
    seen there in an earlier trial already; or where observations away from home are inconsistent with what
    is known, many of them in one trial or some again within a few trials; or where the servo has met a change
    in mid-trial, and most of what was seen since contradicts what is known: if not, it teaches nothing. A
    single odd observation is a mistake of the measurement.

    Attributes:
        home: The gripper's view at home.
        suspects: The pairs of the trial that was inconsistent, until another confirms or refutes it.
        unconfirmed_home: Where the gripper was seen at home once (k, 4), k at most 1, while nothing else
            agreed.
        usual_scores: The largest error of each of the latest trials in each camera (n, 2), in standard
            deviations.

    Args:
        motors: Number of registers m.
    """

    INCONSISTENT_PX = 4.0
    """An observation that is off by less is never inconsistent: the tolerance of a rendezvous, in pixels.
    Choice."""
    INCONSISTENT_FACTOR = 2.5
    """An inconsistent observation is off by this many times the usual score. Tuned (wild worlds 3000-)."""
    USUAL_QUANTILE = 0.9
    """The usual score is this quantile of `usual_scores`. Tuned (wild worlds 3000-)."""
    USUAL_TRIALS = 20
    """The usual score is known after this many trials; until then nothing away from home is inconsistent.
    Tuned (wild worlds 3000-)."""
    CONFIRM_TRIALS = 4
    """Suspects are confirmed where another trial of so many, their own included, is inconsistent. Tuned (wild
    worlds 3000-)."""
    MISTAKEN_PX = 30.0
    """What was further off, and was not confirmed, is not learned. Tuned (wild worlds 3000-)."""
    ENOUGH_IN_ONE_TRIAL = 4
    """This many observations in one trial need no other trial, where most of them are inconsistent. Choice:
    with fewer, two mistaken points are a majority."""

    def __init__(self, motors: int) -> None:
        self.home = HomeView()
        self._none = self.suspects = Pairs.none(motors)
        self.unconfirmed_home = np.empty((0, 4))
        self.usual_scores = np.empty((0, 2))

    def examine(
        self, pairs: Pairs, known: Remembered, announced: Cameras = NO_CAMERA, first: int = 0
    ) -> Finding:
        """Examines one trial.

        Args:
            pairs: Its pairs; at home first.
            known: What is known so far.
            announced: Cameras (2,) of which somebody said that they have changed.
            first: The first pair after a change that the servo met in mid-trial; 0: it met none.
        """
        trial, unconfirmed = int(pairs.trials[0]), self._none
        since = trial - int(self.suspects.trials[0]) if len(self.suspects) else 0
        pairs, jumped = self._home_jump(pairs, known)
        jumped = jumped | announced
        self.home.add(pairs.sensors[0], float(pairs.noise_px[0]), trial)
        if since >= self.CONFIRM_TRIALS:
            unconfirmed = self._cleared(known)
        if first and not jumped.any():
            later = np.arange(len(pairs)) >= first
            cameras = self._mostly_off(pairs.only(later), known)
            if cameras.any():
                return self._changed(pairs, cameras, first)
            pairs = pairs.only(~later)
        gripper, object_ = self._inconsistent(pairs.away(), known)
        if jumped.any():
            return self._changed(pairs, jumped)
        if gripper.any() or object_.any():
            cameras = np.asarray((gripper | object_).any(0))
            if len(self.suspects):
                return self._changed(self.suspects + pairs, cameras)
            if self._enough(gripper):
                return self._changed(pairs, cameras, 1 + int(gripper.any(1).argmax()))
            self.suspects = pairs
            return Finding(ChangeVerdict.SUSPECT, unconfirmed)
        if since == self.CONFIRM_TRIALS - 1:
            unconfirmed = self._cleared(known)
        return Finding(ChangeVerdict.UNCHANGED, unconfirmed + pairs)

    def _changed(self, pairs: Pairs, cameras: Cameras, first: int = 0) -> Finding:
        self.suspects = self._none
        return Finding(ChangeVerdict.CHANGED, pairs, cameras, self.home.before(int(pairs.trials[0])), first)

    def begin_anew(self, trial: int) -> None:
        """The world has changed: from now on only home views since that trial count."""
        self.home.keep_since(trial)
        self.usual_scores = np.empty((0, 2))

    def _home_jump(self, pairs: Pairs, known: Remembered) -> tuple[Pairs, Cameras]:
        """In which cameras home is seen elsewhere, and so is most of the rest, or home was so once before.

        Otherwise that observation was mistaken, and home is taken to be seen where it was.
        """
        home = pairs.sensors[0]
        jumped = self.home.jumped(home)
        near = camera_lengths_px(self.unconfirmed_home - home) < self.home.SIGMAS * self.home.noise_px
        if not jumped.any() or (jumped & self._mostly_off(pairs.away(), known)).any() or near.all(1).any():
            self.unconfirmed_home = np.empty((0, 4))
            return pairs, jumped
        self.unconfirmed_home = home[None].copy()
        sensors = np.concatenate([self.home.reference()[None], pairs.sensors[1:]])
        return replace(pairs, sensors=sensors), np.zeros(2, bool)

    def _mostly_off(self, away: Pairs, known: Remembered) -> Cameras:
        """In which cameras (2,) most pairs away from home are off; of more than two, half is enough."""
        (errors_px, _), (scores, _) = known.errors(away)
        off = (scores > self.home.SIGMAS) & (errors_px > self.INCONSISTENT_PX)
        return np.asarray(2 * off.sum(0) > len(off) - (len(off) > 2))

    def _inconsistent(self, away: Pairs, known: Remembered) -> NDArray[np.bool_]:
        """Where gripper and object (2, n, 2), away from home, are off by far more than is usual."""
        if not len(known.gripper) or not len(away):
            return np.zeros((2, len(away), 2), bool)
        errors_px, scores = known.errors(away)
        limit = np.full(2, np.inf)
        if len(self.usual_scores) >= self.USUAL_TRIALS:
            usual = np.quantile(self.usual_scores, self.USUAL_QUANTILE, axis=0)
            limit = np.maximum(self.home.SIGMAS, self.INCONSISTENT_FACTOR * usual)
        inconsistent = (scores > limit) & (errors_px > self.INCONSISTENT_PX)
        if not inconsistent.any():
            latest = np.concatenate([self.usual_scores, [scores.max((0, 1))]])
            self.usual_scores = latest[-self.USUAL_TRIALS :]
        return np.asarray(inconsistent)

    def _enough(self, inconsistent: NDArray[np.bool_]) -> bool:
        """Whether gripper points (n, 2) of one trial that are inconsistent need no other trial."""
        mostly = bool(inconsistent.any(1).mean() > 0.5)
        return len(inconsistent) >= self.ENOUGH_IN_ONE_TRIAL and mostly

    def _cleared(self, known: Remembered) -> Pairs:
        """Nothing has confirmed the suspicion: its pairs but for those far off, which were mistaken."""
        suspects, self.suspects = self.suspects, self._none
        errors_px = known.errors(suspects.away())[0].max(0)
        return suspects.only(np.concatenate([[True], (errors_px < self.MISTAKEN_PX).all(1)]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it keeps, as named arrays."""
        return {
            "home": self.home.sensors,
            "home_trials": self.home.trials,
            "home_noise_px": np.array([self.home.noise_px]),
            "unconfirmed_home": self.unconfirmed_home,
            "usual_scores": self.usual_scores,
            **prefixed("suspects", self.suspects.arrays()),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        (noise_px,) = checked_array(arrays, "home_noise_px", (1,))
        self.home = HomeView()
        self.home.sensors, self.home.noise_px = checked_array(arrays, "home", (None, 4)), float(noise_px)
        homes = len(self.home.sensors)
        arrays = {"home_trials": np.arange(homes) - homes, **arrays}  # files of earlier versions have none
        self.home.trials = checked_array(arrays, "home_trials", (homes,)).astype(np.int64)
        self.unconfirmed_home = checked_array(arrays, "unconfirmed_home", (None, 4))
        self.usual_scores = checked_array(arrays, "usual_scores", (None, 2))
        self.suspects = Pairs.of(under("suspects", arrays))
