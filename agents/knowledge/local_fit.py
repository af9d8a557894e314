"""An affine fit to the few support points around a place: what is seen there, and the way back."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from .distance import squared_px


class LocalFit:
    """Sensors (4,) as an affine function of registers (m,), by Bayesian least squares.

    Few points imply few directions of the slope; the others stay zero, as the prior (the ridge) has them.

    Attributes:
        centre: Registers (m,) of the nearest point.
        centre_sensors: What is seen there (4,).
        jacobian: ∂sensors/∂registers (4, m).

    Args:
        registers: Of the points (k, m), the nearest one first.
        sensors: What is seen there (k, 4).
        variances: Of what is seen there (k,), in px².
    """

    SLOPE_STD = 2.0
    """Prior standard deviation of a slope, in image units by register. Derived: a whole register's travel
    crosses the image, which is 2 image units wide."""
    LEAST_REACH = 0.03
    """Points are taken to reach at least so far, in registers: as `SupportPoints.CLOSE`."""
    BEND = 0.5 * IMAGE_UNIT
    """A line misses by this many pixels by square pixel of distance. Derived: by d²/2 in image units, as a
    circle of radius 1 departs from its tangent."""
    ITERATIONS = 2
    """Steps of `inverse`; the fit is affine, so that only the noise changes from one to the next. Choice."""

    def __init__(self, registers: Array, sensors: Array, variances: Array) -> None:
        self.centre, self.centre_sensors = registers[0], sensors[0]
        self._sensors = sensors
        noise = variances + (self.BEND * squared_px(sensors - sensors[0])) ** 2
        self._features = np.column_stack([np.ones(len(registers)), registers - registers[0]])
        self._jt_w = self._features.T / noise
        normal = self._jt_w @ self._features
        normal.flat[len(normal) + 1 :: len(normal) + 1] += (IMAGE_UNIT / self.SLOPE_STD) ** 2
        self._covariance = np.linalg.inv(normal)
        self._coefficients = self._covariance @ (self._jt_w @ (sensors - sensors[0]))
        self.jacobian = self._coefficients[1:].T
        squares = squared_px(sensors - sensors[0] - self._features @ self._coefficients)
        self._scale = max(1.0, float((squares / noise).sum()) / len(registers))

    def view(self, registers: Array) -> Array:
        """What should be seen at registers (m,): sensors (4,)."""
        return self.centre_sensors + self._row(registers) @ self._coefficients

    def variance(self, registers: Array) -> float:
        """Of that, in px²."""
        row = self._row(registers)
        return float(row @ self._covariance @ row) * self._scale

    def bend(self, registers: Array) -> float:
        """Variance of what an affine fit leaves out at registers (m,), in px²."""
        moved = self.jacobian @ (registers - self.centre)
        return float(self.BEND * squared_px(moved)) ** 2

    def weights(self, registers: Array) -> Array:
        """What each point (k,) contributes to the view at registers (m,)."""
        return self._row(registers) @ self._covariance @ self._jt_w

    def inverse(self, sensors: Array) -> tuple[Array, float]:
        """Registers (m,) at which sensors (4,) should be seen, and the variance of what is seen, in px².

        They are expected no further off than the points are: the more so, the less is known there.
        """
        normal = self.jacobian.T @ self.jacobian
        reach = max(float(np.square(self._features[:, 1:]).sum(1).max()), self.LEAST_REACH**2)
        gradient = self.jacobian.T @ (sensors - self.view(self.centre))
        registers = self.centre
        for _ in range(self.ITERATIONS):
            noise = self.variance(registers) * IMAGE_UNIT**2
            step = np.linalg.solve(normal + noise / reach * np.eye(len(normal)), gradient)
            registers = np.clip(self.centre + step, -1, 1)
        missed = float(squared_px(sensors - self.view(registers)))
        return registers, self.variance(registers) + missed

    def slope_deviation(self) -> float:
        """Standard deviation of the least known slope, in image units by register."""
        return float(np.sqrt(np.diagonal(self._covariance)[1:].max() * self._scale)) * IMAGE_UNIT

    def _row(self, registers: Array) -> Array:
        return np.concatenate([[1.0], registers - self.centre])
