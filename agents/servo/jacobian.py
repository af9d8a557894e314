"""The sensor-control Jacobian J = ∂d/∂c, estimated from motions and from what they did in the images.

Estimators keep the Jacobian of gripper and object points (8, m): on the waist mount a word moves both. Its
rows are the coordinates of points (4, 2), one after the other. They learn from one motion at a time: from its
executed words and the points' displacement.
"""

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import numpy as np

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.observation import Array, Flags
from ..base.weights import cauchy_weights
from .perception import MARKER_NOISE_PX
from .slopes import Slopes

UNKNOWN_VARIANCE = 1e4
"""Variance of a column of which nothing is known, in (image units per word)². Derived: 100², far beyond any
motor, whose word crosses a few images at most."""
SIGN_CHANGE = 2.0
"""A column that may have changed its sign is wrong by this many times its length. Derived: from j to -j."""


def distance_jacobian(points_jacobian: Array) -> Array:
    """The Jacobian of the image distance (4, m), from that of gripper and object points (8, m)."""
    return points_jacobian[:4] - points_jacobian[4:]


class JacobianEstimate(Protocol):
    """What a servo has found out of the Jacobian in a trial."""

    @property
    def jacobian(self) -> Array:
        """Gripper and object points by words (8, m), in image units; zero where nothing is known."""

    def slopes_for_next(self) -> Slopes | None:
        """What the next trial begins with; None where nothing lasts."""


class Estimator(ABC):
    """What is known of the Jacobian.

    Attributes:
        jacobian: Gripper and object points by words (8, m), in image units; zero where nothing is known.
        noise_px: Standard deviation of an image coordinate, as far as known.
        reach_px: How far the images may be moved in one step by what it knows.
        bridging: Whether it learns also where the beginning of a displacement was predicted, not seen.
        lasting: Whether it holds beyond the next step, and so into the next trial.

    Args:
        motors: m.
        start: From an earlier trial, if there is one.
    """

    bridging: ClassVar[bool] = False
    lasting: ClassVar[bool] = True

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        self.jacobian = np.zeros((8, motors)) if start is None else start.jacobian.copy()
        self.noise_px = MARKER_NOISE_PX
        self.reach_px = np.inf

    def slopes_for_next(self) -> Slopes | None:
        return Slopes.of(self.jacobian) if self.lasting else None

    def predict(self, words: Array) -> Array:
        """Displacement (4, 2) of the points by words (m,)."""
        return (self.jacobian @ words).reshape(4, 2)

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """Learns from a motion.

        Args:
            words: Executed words (m,).
            moved: Displacement of the points (4, 2), from where they were estimated to be.
            seen: Which points were seen before and after (4,).

        Returns:
            The displacement (4, 2) as it is now estimated; where nothing was seen, as predicted.
        """
        return self._learn(words, moved.reshape(8), np.repeat(seen, 2)).reshape(4, 2)

    @abstractmethod
    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """`learn`, coordinate by coordinate: displacement and flags (8,)."""

    def _as_seen(self, words: Array, moved: Array, seen: Flags) -> Array:
        """The displacement (8,) as it was seen, and where it was not, as predicted."""
        return np.where(seen, moved, self.jacobian @ words)

    def forget(self, deviation: float = SIGN_CHANGE) -> None:  # noqa: B027 (without memory nothing is to be forgotten)
        """Trusts what it knows no more than a guess: the next test motions decide.

        Args:
            deviation: By how many times their length columns may be wrong.
        """

    @property
    def blur_px(self) -> float:
        """Standard deviation of the coordinates of a point as estimated."""
        return self.noise_px

    def deviations(self, words: Array) -> Array:
        """Standard deviation (m,) of each column's entries, after test motions by `words` (m,)."""
        return np.sqrt(2) * self.noise_px * IMAGE_UNIT / np.maximum(np.abs(words), 1e-9)


class TestMotions(Estimator):
    """The paper's: a motion of one motor by a word measures its column, displacement by word."""

    __test__ = False  # of no interest to pytest
    lasting = False

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if np.count_nonzero(words) == 1:
            motor = int(np.flatnonzero(words)[0])
            self.jacobian[seen, motor] = moved[seen] / words[motor]
        return self._as_seen(words, moved, seen)


class Broyden(Estimator):
    """The least change that explains the last motion (Broyden's rank-one update; Hosoda & Asada 1994)."""

    REGULARISATION = 1e-6
    """Of |c|² (a guard): a thousandth of a word moves nothing that could be learned from."""

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, words) / (self.REGULARISATION + words @ words)
        return self._as_seen(words, moved, seen)


class TrustRegion(Broyden):
    """Broyden's, with steps as long as its predictions have held (Jägersand 1997)."""

    START_PX = 100.0
    """Length of the first steps: tuned on wild worlds 3000 and up."""
    LEAST_PX, MOST_PX = 16.0, 240.0
    """Lengths of all steps: tuned likewise."""
    HELD, MISSED = 0.3, 0.8
    """A prediction held, and did not, that missed by less, and by more, than this share of what was seen:
    tuned likewise."""
    LONGER, SHORTER = 2.0, 0.5
    """Steps get longer and shorter by these factors. Source: usual for trust regions (Dennis & Schnabel
    1983)."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self.reach_px = self.START_PX

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if words.any() and self.jacobian.any(0).all() and moved[seen].any():
            missed = np.linalg.norm((moved - self.jacobian @ words)[seen]) / np.linalg.norm(moved[seen])
            change = self.LONGER if missed < self.HELD else self.SHORTER if missed > self.MISSED else 1.0
            self.reach_px = float(np.clip(change * self.reach_px, self.LEAST_PX, self.MOST_PX))
        return super()._learn(words, moved, seen)


class RecursiveLeastSquares(Estimator):
    """Least squares over all motions, older ones counting less and less (Piepmeier et al. 1999)."""

    FORGETTING = 0.5
    """A motion counts so much less with each that follows it: tuned on wild worlds 3000 and up."""
    NOISE = 1e-4
    """Variance of a displacement, in square image units, (2.6 px)²: tuned likewise."""
    START_VARIANCE = 0.05
    """Of the entries of a Jacobian from an earlier trial, in (image units by word)²: tuned likewise."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self._covariance = np.eye(motors) * (UNKNOWN_VARIANCE if start is None else self.START_VARIANCE)

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        if not words.any():
            return self._as_seen(words, moved, seen)
        older = self._covariance / self.FORGETTING
        gain = older @ words / (self.NOISE + words @ older @ words)
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, gain)
        updated = older - np.outer(gain, words @ older)
        self._covariance = updated * min(1.0, UNKNOWN_VARIANCE * len(words) / np.trace(updated))
        return self._as_seen(words, moved, seen)

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        self._covariance = np.eye(len(self._covariance)) * UNKNOWN_VARIANCE


class LocalLeastSquares(Estimator):
    """Least squares over stored motions, nearer ones counting more (Farahmand et al. 2007).

    Residuals are weighed once more (IRLS), so that a motion whose points were mistaken counts little
    (Shademan et al. 2010).
    """

    WIDTH = 0.3
    """Distances of motions, in registers, are divided by this; their weight goes with the inverse square:
    tuned on wild worlds 3000 and up."""
    NEAR = 0.01
    """Added to that square: within a tenth (√0.01) of `WIDTH` motions weigh about alike. Tuned likewise."""
    NOISE_PX, NOISE_PARTS = 2.0, 10.0
    """Variance of a slope by noise: of this many pixels by `WIDTH`, squared and divided by that. Tuned
    likewise."""
    LENGTH_PARTS = 2.0
    """Variance of a slope by what a line misses: the square of the word, divided by that. Tuned likewise."""
    PRIOR = 1e-3
    """Weight of the Jacobian that it begins with: tuned likewise."""
    ROBUST_PX = 20.0
    """A motion missed by that much counts half: tuned likewise."""
    PASSES = 3
    """So often residuals are weighed anew. Source: a few passes of IRLS are usual (Holland & Welsch 1977)."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self.forget()

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        motors = self.jacobian.shape[1]
        self._prior = self.jacobian.copy()
        self._middles, self._sent = np.empty((2, 0, motors))
        self._moves, self._looks = np.empty((2, 0, 8))

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        self._middles = np.concatenate([self._middles - words, [-words / 2]])
        self._sent = np.concatenate([self._sent, [words]])
        self._moves = np.concatenate([self._moves, [moved]])
        self._looks = np.concatenate([self._looks, [seen]])
        far = (self._middles**2).sum(1) / self.WIDTH**2
        still = (self.NOISE_PX * IMAGE_UNIT / self.WIDTH) ** 2 / self.NOISE_PARTS
        noise = still + (self._sent**2).sum(1) / self.LENGTH_PARTS
        near = (1 / ((far + self.NEAR) * noise))[:, None] * self._looks
        weights = near
        for _ in range(self.PASSES):
            self.jacobian = self._fit(weights)
            residual = self._moves - self._sent @ self.jacobian.T
            weights = near * cauchy_weights(residual / (self.ROBUST_PX * IMAGE_UNIT))
        return self._as_seen(words, moved, seen)

    def _fit(self, weights: Array) -> Array:
        """The Jacobian (8, m) of least squares by weights (motions, 8), all rows at once."""
        count, motors = self._sent.shape
        squares = (self._sent[:, :, None] * self._sent[:, None]).reshape(count, -1)
        normal = (weights.T @ squares).reshape(-1, motors, motors) + self.PRIOR * np.eye(motors)
        jt_w = (weights * self._moves).T @ self._sent + self.PRIOR * self._prior
        return np.asarray(np.linalg.solve(normal, jt_w[:, :, None])[:, :, 0])


class Kalman(Estimator):
    """A Kalman filter on points and Jacobian, which wander as the arm moves (after Qian & Su 2002).

    The state of an image point are the rows (p, J) of its two coordinates, which share one covariance
    (1 + m, 1 + m): a motion moves p by J c, and then p is seen, or is not. The random walk of a column grows
    with its length and with how far the arm went; that of p is a share of its displacement, for the curve
    that a straight line leaves out. Where points are noisy, the filter averages observations at different
    places; where one is missing, it goes on by prediction. Where noise turns out larger than it was thought
    to be, so does the variance of all that was concluded.

    The default: where observations are clear all estimators that last need about as few motions
    (`configs/first-trials.yaml`); where image points are noisy only this one goes on reaching
    (`configs/estimators.yaml`).
    """

    bridging = True
    WANDERING = 0.2
    """A column wanders by this share of its length over a word of 1: tuned on wild worlds 3000 and up."""
    START_DEVIATION = 0.3
    """Standard deviation of the entries of a Jacobian from an earlier trial, in image units by word: tuned
    likewise."""
    CURVE = 0.02
    """A straight line misses by this share of a displacement: tuned likewise."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        super().__init__(motors, start)
        self._noise: float | None = None
        unsure = UNKNOWN_VARIANCE if start is None else self.START_DEVIATION**2
        diagonal = [(self.noise_px * IMAGE_UNIT) ** 2, *[unsure] * motors]
        self._covariance = np.tile(np.diag(diagonal), (4, 1, 1))
        self._transition = np.eye(1 + motors)
        self._columns = np.arange(1, 1 + motors)

    def _learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        noise = (self.noise_px * IMAGE_UNIT) ** 2
        if self._noise is None:
            self._covariance[:, 0, 0] = self._noise = noise
        expected = self.jacobian @ words
        self._transition[0, 1:] = words
        predicted = self._transition @ (self._covariance * (noise / self._noise)) @ self._transition.T
        self._noise = noise
        squares = expected * expected
        predicted[:, 0, 0] += self.CURVE**2 * (squares[::2] + squares[1::2])
        walk = self.WANDERING**2 * float(words @ words)
        predicted[:, self._columns, self._columns] += walk * self._squared_lengths()
        gain = predicted[:, 0] * (seen[::2] / (predicted[:, 0, 0] + noise))[:, None]
        self._covariance = predicted - gain[:, :, None] * predicted[:, :1]
        corrections = gain.repeat(2, 0) * (moved - expected)[:, None]
        self.jacobian += corrections[:, 1:]
        return np.asarray(expected + corrections[:, 0])

    def _squared_lengths(self) -> Array:
        """Mean square (m,) of what a word does to a point."""
        return np.einsum("ij,ij->j", self.jacobian, self.jacobian) / 4

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        self._covariance[:, self._columns, self._columns] += deviation**2 * self._squared_lengths()

    @property
    def blur_px(self) -> float:
        return float(np.sqrt(self._covariance[:, 0, 0].max())) / IMAGE_UNIT

    def deviations(self, words: Array) -> Array:
        return np.asarray(np.sqrt(self._covariance[:, self._columns, self._columns].max(0)))


KNOWN_PX, UNKNOWN_PX, SHARE = 4.0, 6.0, 0.08
"""A linear prediction misses by the first, or by the second where it does not rest on motions like this one,
and by this share of the displacement, as standard deviations: tuned on wild worlds 3000 and up."""


def linear_deviations_px(moved: Array, known: Flags) -> Array:
    """By how much points (4,) may be off whose displacement (4, 2) was predicted by a linear function.

    Args:
        moved: The prediction, in image units.
        known: For which points (4,) it rests on motions like this one.
    """
    return np.where(known, KNOWN_PX, UNKNOWN_PX) + SHARE * lengths_px(moved)


ESTIMATORS: dict[str, type[Estimator]] = {
    "broyden": Broyden,
    "trust_region": TrustRegion,
    "rls": RecursiveLeastSquares,
    "kalman": Kalman,
    "local": LocalLeastSquares,
}
"""Estimators that keep J up to date by every motion, by name. `TestMotions` measures it anew."""
