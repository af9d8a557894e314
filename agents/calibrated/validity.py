"""Whether what was identified of a robot still holds: a camera may be knocked, a motor exchanged."""

from __future__ import annotations

from enum import Enum


class Validity(Enum):
    """Whether what was identified still holds."""

    VALID = "the latest observations agree with it"
    DOUBTED = "they do not, once: the robot acts by the latest fit, and keeps the earlier one for comparison"
    NOISE_UNKNOWN = "they do not, again; but nobody knows yet how noisy they are"
    INVALID = "they do not, again: all that was known is dropped"


class ValidityCheck:
    """Judges by each motion of a trial whether what was identified still holds.

    The paper's section 1 asks for a robot that keeps determining its parameters; when it is to begin anew, it
    leaves open. Here: where the model contradicts the latest observations, or where it misses again and
    again, twice running.
    """

    INCONSISTENT = 50.0
    """Observations contradict the model where the least cost rises by more, see `Identification.innovation`;
    about 4 is usual. Tuned on wild worlds 3000 and up."""
    TRIES, MISSED = 6, 8.0
    """So they do where the object is still missed, by this many times the noise, after this many motions:
    tuned likewise."""
    CONTRADICTIONS = 2
    """This many in a row end the validity: a single one may be a mistaken point. Choice."""

    def __init__(self) -> None:
        self._contradictions = self._tries = 0
        self._noise_known = False

    def begin(self) -> None:
        """Something new was identified."""
        self._tries = 0

    def judge(self, innovation: float, distance_px: float, noise_px: float) -> Validity:
        """What the latest observation says of the model.

        Args:
            innovation: See `Identification.innovation`.
            distance_px: Image distance between gripper and object.
            noise_px: Standard deviation of an image coordinate.
        """
        missed = self._tries >= self.TRIES and distance_px > self.MISSED * noise_px
        contradicted = missed or innovation > self.INCONSISTENT
        self._contradictions = self._contradictions + 1 if contradicted else 0
        if self._contradictions < self.CONTRADICTIONS:
            self._tries += 1
            return Validity.DOUBTED if self._contradictions else Validity.VALID
        if not self._noise_known:
            self._contradictions, self._noise_known = self._contradictions - 1, True
            return Validity.NOISE_UNKNOWN
        self._contradictions = 0
        return Validity.INVALID
