"""Scattered support points with local affine fits: placed "where they are actually needed" (section 4.3)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.checks import check_number, checked_array
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from .grid_table import Gain, squared_px
from .learning_servo import LearningServo, Recall, knowledge_base


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


@knowledge_base(
    "support_points", "The paper's second alternative: points stored where they are needed.", LearningServo
)
class SupportPoints:
    """Pairs of sensors and registers, no two of them close; recall reads a local affine fit backwards.

    Registers are known exactly and image points are noisy; so the nearest pairs are fitted as sensors over
    registers. A success between support points corrects theirs: it makes a new one only where the fit missed.

    Attributes:
        registers: Of the support points (n, m).
        sensors: What is seen there (n, 4), in image units.
        variances: Of what is seen there (n,), in px².

    Args:
        motors: Number of registers m.
        points: The most support points that are kept; the most uncertain one is dropped.
        neighbours: This many nearest points are fitted, and at least one more than there are motors.
        rate: Share of a miss that one success corrects, where the gain is constant.
        kalman: Whether a Kalman filter for each support point decides instead; then older ones weigh less.
    """

    prior_knowledge = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE, PriorKnowledge.WORD_LIMIT})
    NEW_POINT_PX = 2.0
    """A fit that is off by more needs a new point. Choice: half the tolerance of a rendezvous."""
    CLOSE = 0.03
    """No new point is made where one's registers differ by no more than this. Choice: some 8 px, where a
    register moves a point by half an image."""
    SLOPE_DEVIATION = 0.3
    """A Jacobian is implied where no slope is less certain, in image units by register. Tuned (wild worlds
    3000-)."""
    INCONSISTENT = 9.0
    """A square error this many times its variance, 3 standard deviations, is inconsistent with what is known:
    neighbours are corrected as well. Choice."""
    OBSERVATION_VARIANCE = 1.0
    """Of what is seen, px². Derived: 0.7 px in each coordinate, as of a good mark, and 2 · 0.7² = 1."""
    DRIFT_VARIANCE = 0.04
    """What one success adds to variances, px². Derived: (0.2 px)², as points are met in every trial."""

    def __init__(
        self, motors: int, points: int = 1000, neighbours: int = 8, rate: float = 0.7, kalman: bool = False
    ) -> None:
        self.neighbours = max(check_number("neighbours", neighbours, least=1, whole=True), motors + 1)
        self.points = check_number("points", points, least=self.neighbours, whole=True)
        self.gain = Gain(rate, kalman, self.OBSERVATION_VARIANCE, self.DRIFT_VARIANCE)
        self.registers = np.empty((0, motors))
        self.sensors = np.empty((0, 4))
        self.variances = np.empty(0)

    def __repr__(self) -> str:
        return (
            f"SupportPoints(points={self.points}, neighbours={self.neighbours}, "
            f"rate={self.gain.rate}, kalman={self.gain.kalman})"
        )

    def recall(self, sensors: Array) -> Recall | None:
        if not len(self.sensors):
            return None
        registers, variance = self._fit(self._nearest(self.sensors, sensors)).inverse(sensors)
        return Recall(registers, float(np.sqrt(variance)))

    def jacobian(self, registers: Array) -> Array | None:
        if len(self.registers) < self.neighbours:
            return None
        fit = self._fit(self._nearest(self.registers, registers))
        return fit.jacobian if fit.slope_deviation() < self.SLOPE_DEVIATION else None

    def learn(self, sensors: Array, registers: Array) -> None:
        """Corrects the nearest support points by what their fit missed, or adds one."""
        self.variances = self.gain.aged(self.variances)
        if len(self.registers):
            nearest = self._nearest(self.registers, registers)
            fit = self._fit(nearest)
            error = sensors - fit.view(registers)
            square, bend = float(squared_px(error)), fit.bend(registers)
            expected = fit.variance(registers) + bend + self.gain.success_variance
            enough = square < self.NEW_POINT_PX**2 or np.abs(fit.centre - registers).max() < self.CLOSE
            if enough or square > self.INCONSISTENT * expected:
                weights = fit.weights(registers)
                gains, self.variances[nearest] = self.gain.correct(weights, self.variances[nearest], bend)
                self.sensors[nearest] += gains[:, None] * error
            if enough:
                return
        self.registers = np.concatenate([self.registers, [registers]])
        self.sensors = np.concatenate([self.sensors, [sensors]])
        self.variances = np.concatenate([self.variances, [self.gain.success_variance]])
        if len(self.registers) > self.points:
            self._keep(np.delete(np.arange(len(self.registers)), rounded(self.variances[:-1]).argmax()))

    def arrays(self) -> dict[str, NDArray[Any]]:
        return {name: getattr(self, name).copy() for name in ("registers", "sensors", "variances")}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        registers = checked_array(arrays, "registers", (None, self.registers.shape[1]))
        count = len(registers)
        sensors = checked_array(arrays, "sensors", (count, 4))
        variances = checked_array(arrays, "variances", (count,))
        self.registers, self.sensors, self.variances = registers, sensors, variances

    def _nearest(self, points: Array, place: Array) -> NDArray[np.intp]:
        """Indices of the nearest of `points` (n, k), the very nearest first."""
        apart = points - place
        squares = np.einsum("ij,ij->i", apart, apart)
        near = np.arange(len(points))
        if len(points) > self.neighbours:
            most = np.partition(squares, self.neighbours)[self.neighbours]
            near = np.flatnonzero(squares <= most)
        return near[rounded(squares[near]).argsort(kind="stable")][: self.neighbours]

    def _fit(self, nearest: NDArray[np.intp]) -> LocalFit:
        return LocalFit(self.registers[nearest], self.sensors[nearest], self.variances[nearest])

    def _keep(self, kept: NDArray[np.intp]) -> None:
        self.registers, self.sensors, self.variances = (
            self.registers[kept],
            self.sensors[kept],
            self.variances[kept],
        )
