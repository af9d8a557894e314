"""What every estimator of the sensor-control Jacobian has in common.

Estimators keep the Jacobian of gripper and object points (8, m): on the waist mount a word moves both. Its
rows are the coordinates of points (4, 2), one after the other. They learn from one motion at a time: from its
executed words and the points' displacement.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, Flags
from ..perception.noise import MARKER_NOISE_PX
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
        """See `JacobianEstimate`."""
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
