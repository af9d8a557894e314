"""Gripper and object points as a linear function of registers, near where a robot has been."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT, RANK, RANK_OF_SQUARES, lengths_px

from ...base.observation import POINTS, Array, Observation


class LinearView:
    """The Jacobian by all looks so far, by least squares; of motors that never moved its columns are zero.

    Attributes:
        jacobian: Gripper and object points by words (8, m), in image units.
        variances: Covariances of a row of it (m, m).

    Args:
        motors: m.
    """

    def __init__(self, motors: int) -> None:
        self.jacobian = np.zeros((2 * POINTS, motors))
        self.variances = np.zeros((motors, motors))
        self._looks: list[Observation] = []

    def look(self, observation: Observation, noise_px: float) -> None:
        """Takes in a look; points that it does not show are not counted."""
        self._looks.append(observation)
        registers = np.array([each.registers for each in self._looks])
        moved = np.flatnonzero(np.ptp(registers, axis=0))
        if not len(moved):
            return
        equations = np.column_stack([np.ones(len(registers)), registers[:, moved]])
        for point in range(POINTS):
            seen = np.array([each.visible[point] for each in self._looks])
            if seen.sum() > 1:
                points = np.array([each.points[point] for each in self._looks])[seen]
                found = np.linalg.lstsq(equations[seen], points, rcond=RANK)[0]
                self.jacobian[2 * point : 2 * point + 2, moved] = found[1:].T
        inverse = np.linalg.pinv(equations.T @ equations, hermitian=True, rcond=RANK_OF_SQUARES)
        self.variances[np.ix_(moved, moved)] = (noise_px * IMAGE_UNIT) ** 2 * inverse[1:, 1:]

    def correct(self, words: Array, before: Observation, after: Observation, noise_px: float) -> None:
        """Changes the Jacobian by the least that explains a motion of words (m,), motors alike (Broyden).

        The less the motion should show above noise, the less it changes: as a Kalman filter does for which
        each column is unsure by its own length.
        """
        scaled = words * np.square(self.jacobian).sum(0)
        of_noise = 2 * len(self.jacobian) * (noise_px * IMAGE_UNIT) ** 2
        seen = np.repeat(before.visible & after.visible, 2)
        moved = (after.points - before.points).reshape(-1)
        error = np.where(seen, moved - self.jacobian @ words, 0.0)
        self.jacobian = self.jacobian + np.outer(error, scaled) / (scaled @ words + of_noise)

    def moved_px(self, words: Array) -> float:
        """How far words (m,) should move the image point that goes farthest, in pixels."""
        return float(lengths_px((self.jacobian @ words).reshape(POINTS, 2)).max())

    def each_px(self, words: Array) -> float:
        """How far one motor by its word alone should move an image point at most, in pixels."""
        alone = (self.jacobian * words).reshape(POINTS, 2, -1).swapaxes(1, 2)
        return float(lengths_px(alone).max())

    def error_px(self, words: Array, before: Observation, after: Observation) -> float:
        """By how much words (m,) moved an image point otherwise than they should have, at most, in pixels."""
        otherwise = after.points - before.points - (self.jacobian @ words).reshape(POINTS, 2)
        seen = before.visible & after.visible
        return float(lengths_px(otherwise)[seen].max(initial=0.0))
