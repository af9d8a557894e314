"""When the world has changed: the network errs, motion after motion, as it seldom erred before."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.checks import checked_array
from ...base.observation import Array


@dataclass(frozen=True)
class JudgedMotion:
    """A motion, and what the network said of it before it learned from it.

    Attributes:
        made: The words that were made (m,).
        said: The words (m,) that the network has for the change that was seen.
        size: Length of that change, which errors are relative to.
        moment: How many observations had been kept after the motion.
        trial: The trial in which it was made.
    """

    made: Array
    said: Array
    size: float
    moment: int
    trial: int

    def error(self, signs: Array | float = 1.0) -> float:
        """The relative error of the words said, had some motors reversed: signs (m,) of -1."""
        return float(np.linalg.norm(self.made * signs - self.said) / self.size)


class NetworkChange(NamedTuple):
    """What the detector has found.

    Attributes:
        since: After how many kept observations the world changed.
        signs: -1 for a motor that reversed (m,), where that explains the errors; None where nothing does.
    """

    since: int
    signs: Array | None


class ErrorDetector:
    """Cumulative sum tests (Page 1954) on the ranks of errors among the robot's own earlier errors.

    The error of a motion is what the network got wrong before it learned from it. The share p of earlier
    errors that were as large is uniform while nothing changes, whatever the noise, and -log p, the
    *surprise*, has mean 1. One sum, never below zero, adds up surprise - `DRIFT`: it grows where large errors
    follow each other. One more for each motor adds up by how much less the surprise would be, had that motor
    reversed, less what would be surprising still: errors of noise, of a network that knows little yet, and of
    another change would not become usual, so these sums stay near zero.

    Args:
        motors: m.
    """

    WINDOW = 200
    """Earlier errors that count. Choice: older ones are of a network that knew less."""
    FEWEST = 30
    """With fewer earlier errors nothing is suspected (a guard): p has to be able to get small."""
    DRIFT = 2.0
    """Choice: twice what surprise is on average while nothing changes."""
    LIMIT = 40.0
    """Independent errors pass it once in exp(0.8 · 40) motions (0.8 solves exp(-2 x) = 1 - x). Errors of one
    hard trial, or of a part of the work space that is new, are not independent: in 21,600 quiet motions of
    wild worlds 50010-50016, with 0.5 px noise, 3 px noise and 10 % mistaken points, the largest sum was 21.
    Within 150 motions after a camera was re-aimed it passed 65 in all 6 lives."""
    REVERSED_LIMIT = 10.0
    """In the same quiet motions, and after a camera was re-aimed, no motor's sum passed 4.5. Where a motor
    reversed, its sum passed 11.8 in 14 of 16 lives within 100 to 150 motions, mostly within 20; the other two
    had mistaken points. Where there is a change at all, half of it is enough."""

    def __init__(self, motors: int) -> None:
        self._motors = motors
        self._errors: list[float] = []
        self._begin()

    def _begin(self) -> None:
        """Starts all sums from zero; errors that were under suspicion are dropped."""
        self._suspected: list[float] = []
        self._sums = np.zeros(1 + self._motors)
        self._since = np.zeros((1 + self._motors, 2), np.int64)

    def observe(self, motion: JudgedMotion) -> NetworkChange | None:
        """Takes in a motion; returns what must have changed, if anything."""
        error = motion.error()
        if len(self._errors) < self.FEWEST:
            self._errors.append(error)
            self._since[:] = motion.moment, motion.trial
            return None
        signs = np.ones((self._motors, self._motors)) - 2 * np.eye(self._motors)
        errors = np.array([error, *(motion.error(each) for each in signs)])
        surprise = self._surprise(errors)
        unexplained = surprise[1:] + np.maximum(surprise[1:] - self.DRIFT, 0.0)
        self._sums += surprise[0] - np.array([self.DRIFT, *unexplained])
        self._sums = np.maximum(self._sums, 0.0)
        self._since[self._sums == 0] = motion.moment, motion.trial
        self._suspected.append(error)
        if not self._sums.any():
            self._errors = [*self._errors, *self._suspected][-self.WINDOW :]
            self._suspected = []
        change = self._found(motion, signs)
        if change is not None:
            self._begin()
            self._since[:] = motion.moment, motion.trial
        return change

    def _found(self, motion: JudgedMotion, signs: Array) -> NetworkChange | None:
        """What has changed by the sums as they are, if anything."""
        unexplained = self._sums[0] > self.LIMIT and self._since[0, 1] != motion.trial
        likeliest = 1 + int(np.argmax(self._sums[1:]))
        if self._sums[likeliest] > self.REVERSED_LIMIT / (2 if unexplained else 1):
            return NetworkChange(int(self._since[likeliest, 0]), signs[likeliest - 1])
        if not unexplained:
            return None
        self._errors = []
        return NetworkChange(int(self._since[0, 0]), None)

    def usual_error(self) -> float:
        """The median of earlier errors; infinite where there are none."""
        return float(np.median(self._errors)) if self._errors else float("inf")

    def _surprise(self, errors: Array) -> Array:
        """-log of the share of earlier errors that were as large as each of these (n,), itself included."""
        larger = (np.array(self._errors) >= errors[:, None]).sum(1)
        return np.asarray(-np.log((1 + larger) / (1 + len(self._errors))))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Earlier errors and all that is under suspicion, by name."""
        return {
            "errors": np.array(self._errors),
            "suspected": np.array(self._suspected),
            "sums": self._sums.copy(),
            "since": self._since.copy(),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: An array is missing, damaged or of another shape.
        """
        errors, suspected = (
            checked_array(arrays, name, (None,)).tolist() for name in ("errors", "suspected")
        )
        sums = checked_array(arrays, "sums", (1 + self._motors,))
        since = checked_array(arrays, "since", (1 + self._motors, 2)).astype(np.int64)
        self._errors, self._suspected, self._sums, self._since = errors, suspected, sums, since
