"""The sensor-control Jacobian J = ∂d/∂c, estimated from motions and what they did in the images.

Estimators keep the Jacobian of gripper and object points (8, m): on the waist mount a word moves both. That
of the image distance (4, m) is the difference of its halves. They learn from one motion at a time: executed
words, and the points' displacement.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from agents.base.agent import Array, Look
from calfree_gym.image import IMAGE_UNIT

Flags = NDArray[np.bool_]

NOISE_PX = 0.7
"""Noise of an image coordinate before any is known: that of a good marker."""
UNKNOWN = 1e4
"""Variance of a column of which nothing is known, in (image units per word)²."""


def both_points(look: Look) -> Array:
    """Gripper and object points (8,)."""
    return np.concatenate([look.gripper, look.object])


def both_seen(look: Look) -> Flags:
    """Which coordinates of `both_points` are seen now (8,)."""
    return np.repeat(look.visible, 2)


def distance_jacobian(points_jacobian: Array) -> Array:
    """The Jacobian of the image distance (4, m), from that of gripper and object points (8, m)."""
    return points_jacobian[:4] - points_jacobian[4:]


def displacement_px(moved: Array) -> float:
    """The largest displacement of one point in one image, in pixels, of points (4,) or (8,)."""
    return float(np.hypot(moved[::2], moved[1::2]).max()) / IMAGE_UNIT


class Estimator(ABC):
    """What is known of the Jacobian.

    Attributes:
        jacobian: Gripper and object points by words (8, m), in image units; zero where nothing is known.
        noise_px: Standard deviation of an image coordinate, as far as known.
        reach_px: How far the images may be moved in one step by what it knows.
        trusted: The looks of a trial that were believed, none of them merely expected.
        bridging: Whether it learns also where the beginning of a displacement was predicted, not seen.
        lasting: Whether it holds beyond the next step; else test motions come before every one.

    Args:
        motors: m.
        start: A Jacobian (8, m) from an earlier trial, if there is one.
    """

    bridging = False
    lasting = True

    def __init__(self, motors: int, start: Array | None = None) -> None:
        self.jacobian = np.zeros((8, motors)) if start is None else start.copy()
        self.noise_px = NOISE_PX
        self.reach_px = np.inf
        self.trusted: list[Look] = []

    def restart(self, start: Array) -> None:
        """Begins anew with a Jacobian (8, m); what was seen stays."""
        trusted = self.trusted
        self.__init__(start.shape[1], start)  # type: ignore[misc]
        self.trusted = trusted

    @abstractmethod
    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """Learns from a motion.

        Args:
            words: Executed words (m,).
            moved: Displacement of the points (8,), from where they were believed to be.
            seen: Which of it was seen before and after (8,).

        Returns:
            The displacement (8,) as it is now believed; where nothing was seen, as expected.
        """

    def _as_seen(self, words: Array, moved: Array, seen: Flags) -> Array:
        """The displacement (8,) as it was seen, and where it was not, as expected."""
        return np.where(seen, moved, self.jacobian @ words)

    def forget(self, deviation: float = 2.0) -> None:  # noqa: B027 (without memory nothing is to be forgotten)
        """Trusts what it knows no more than a guess: the next test motions decide.

        Args:
            deviation: By how many times their length columns may be wrong; by 2 if a sign may have changed.
        """

    @property
    def blur_px(self) -> float:
        """Standard deviation of the coordinates of a point as believed."""
        return self.noise_px

    def deviations(self, words: Array) -> Array:
        """Standard deviation (m,) of each column's entries, after test motions by `words` (m,)."""
        return np.sqrt(2) * self.noise_px * IMAGE_UNIT / np.maximum(np.abs(words), 1e-9)


class TestMotions(Estimator):
    """The paper's: a motion of one motor measures its column; forgotten after each step (section 3.2)."""

    __test__ = False  # of no interest to pytest
    lasting = False

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """See `Estimator`."""
        if np.count_nonzero(words) == 1:
            motor = int(np.flatnonzero(words)[0])
            self.jacobian[seen, motor] = moved[seen] / words[motor]
        return self._as_seen(words, moved, seen)


class Broyden(Estimator):
    """The least change that explains the last motion (Broyden's rank-one update; Hosoda & Asada 1994)."""

    REGULARISATION = 1e-6

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """See `Estimator`."""
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, words) / (self.REGULARISATION + words @ words)
        return self._as_seen(words, moved, seen)


class TrustRegion(Broyden):
    """Broyden's, with steps as long as its predictions have held (Jägersand 1997)."""

    LEAST_PX, MOST_PX = 16.0, 240.0

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self.reach_px = 100.0

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """See `Estimator`."""
        if self.jacobian.any(0).all() and moved[seen].any():
            missed = np.linalg.norm((moved - self.jacobian @ words)[seen]) / np.linalg.norm(moved[seen])
            change = 2.0 if missed < 0.3 else 0.5 if missed > 0.8 else 1.0
            self.reach_px = float(np.clip(change * self.reach_px, self.LEAST_PX, self.MOST_PX))
        return super().learn(words, moved, seen)


class RecursiveLeastSquares(Estimator):
    """Least squares over all motions, older ones counting less and less (Piepmeier et al. 1999)."""

    FORGETTING = 0.5
    NOISE = 1e-4

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self._covariance = np.eye(motors) * (UNKNOWN if start is None else 0.05)

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """See `Estimator`."""
        older = self._covariance / self.FORGETTING
        gain = older @ words / (self.NOISE + words @ older @ words)
        missed = (moved - self.jacobian @ words)[seen]
        self.jacobian[seen] += np.outer(missed, gain)
        updated = older - np.outer(gain, words @ older)
        self._covariance = updated * min(1.0, UNKNOWN * len(words) / np.trace(updated))
        return self._as_seen(words, moved, seen)

    def forget(self, deviation: float = 2.0) -> None:
        """See `Estimator`."""
        self._covariance = np.eye(len(self._covariance)) * UNKNOWN


class Kalman(Estimator):
    """A Kalman filter on points and Jacobian, which wander as the arm moves (after Qian & Su 2002).

    The state of an image point are the rows (p, J) of its two coordinates, which share one covariance
    (1 + m, 1 + m): a motion moves p by J c, and then p is seen, or is not. The random walk of a column grows
    with its length and with how far the arm went; that of p is a share of its displacement, for the curve
    that a straight line leaves out. Where points are noisy, the filter averages over looks at different
    places; where one is missing, it goes on by prediction. Where noise turns out larger than it was thought
    to be, so does the variance of all that was concluded.

    The default: where looks are clear all estimators that last need about as few motions (`python -m
    experiments benchmark controllers`); where image points are noisy only this one goes on reaching
    (`configs/estimators.yaml`: 99 % of wild worlds at 8 px, the next best 76 %).
    """

    bridging = True
    WANDERING = 0.2
    START_DEVIATION = 0.3
    CURVE = 0.02

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self._noise = (self.noise_px * IMAGE_UNIT) ** 2
        unsure = UNKNOWN if start is None else self.START_DEVIATION**2
        self._covariance = np.tile(np.diag([self._noise, *[unsure] * motors]), (4, 1, 1))
        self._transition = np.eye(1 + motors)
        self._columns = np.arange(1, 1 + motors)

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """See `Estimator`."""
        noise = (self.noise_px * IMAGE_UNIT) ** 2
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

    def forget(self, deviation: float = 2.0) -> None:
        """See `Estimator`."""
        self._covariance[:, self._columns, self._columns] += deviation**2 * self._squared_lengths()

    @property
    def blur_px(self) -> float:
        """See `Estimator`."""
        return float(np.sqrt(self._covariance[:, 0, 0].max())) / IMAGE_UNIT

    def deviations(self, words: Array) -> Array:
        """See `Estimator`."""
        return np.asarray(np.sqrt(self._covariance[:, self._columns, self._columns].max(0)))


class LocalLeastSquares(Estimator):
    """Least squares over stored motions, nearer ones counting more (Farahmand et al. 2007).

    Residuals are weighed once more (IRLS), so that a motion whose points were mistaken counts little
    (Shademan et al. 2010).
    """

    WIDTH = 0.3
    PRIOR = 1e-3
    ROBUST_PX = 20.0

    def __init__(self, motors: int, start: Array | None = None) -> None:
        super().__init__(motors, start)
        self.forget()

    def forget(self, deviation: float = 2.0) -> None:
        """See `Estimator`."""
        motors = self.jacobian.shape[1]
        self._prior = self.jacobian.copy()
        self._middles, self._sent = np.empty((2, 0, motors))
        self._moves, self._looks = np.empty((2, 0, 8))

    def learn(self, words: Array, moved: Array, seen: Flags) -> Array:
        """See `Estimator`."""
        self._middles = np.concatenate([self._middles - words, [-words / 2]])
        self._sent = np.concatenate([self._sent, [words]])
        self._moves = np.concatenate([self._moves, [moved]])
        self._looks = np.concatenate([self._looks, [seen]])
        far = (self._middles**2).sum(1) / self.WIDTH**2
        noise = (2 * IMAGE_UNIT / self.WIDTH) ** 2 / 10 + (self._sent**2).sum(1) / 2
        near = (1 / ((far + 0.01) * noise))[:, None] * self._looks
        weights = near
        for _ in range(3):
            self.jacobian = self._fit(weights)
            residual = self._moves - self._sent @ self.jacobian.T
            weights = near / (1 + (residual / (self.ROBUST_PX * IMAGE_UNIT)) ** 2)
        return self._as_seen(words, moved, seen)

    def _fit(self, weights: Array) -> Array:
        """The Jacobian (8, m) of least squares by weights (motions, 8), all rows at once."""
        count, motors = self._sent.shape
        squares = (self._sent[:, :, None] * self._sent[:, None]).reshape(count, -1)
        normal = (weights.T @ squares).reshape(-1, motors, motors) + self.PRIOR * np.eye(motors)
        pulled = (weights * self._moves).T @ self._sent + self.PRIOR * self._prior
        return np.asarray(np.linalg.solve(normal, pulled[:, :, None])[:, :, 0])


ESTIMATORS: dict[str, type[Estimator]] = {
    "test_motions": TestMotions,
    "broyden": Broyden,
    "trust_region": TrustRegion,
    "rls": RecursiveLeastSquares,
    "kalman": Kalman,
    "local": LocalLeastSquares,
}
