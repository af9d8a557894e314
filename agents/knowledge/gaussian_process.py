"""Scattered support points under a Gaussian process: what is seen, as a function of the registers.

The paper asks for support points "in an irregular pattern where they are actually needed" (section 4.3).
Registers are known exactly and image points are noisy; so the regression runs from registers to sensor
vectors, and recall inverts it: four coordinates, three registers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS, IMAGE_UNIT

from ..base.checks import check_number, checked_array
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from .interface import Change, Recall


class GaussianProcess:
    """Each camera's image points (2,) as a Gaussian process over registers (m,), read backwards to recall.

    The kernel is that of a quadratic whose coefficients are unknown, and of smooth departures from it. Each
    support point has its own noise in each camera: so what was mapped with doubt weighs less than what was
    seen. Where there are too many, those that add least to the others are dropped.

    Attributes:
        registers: Of the support points (n, m).
        sensors: What is seen there (n, 4), in image units.
        variances: Of the noise in each camera (n, 2), in square image units.

    Args:
        motors: Number of registers m.
        points: Support points are pruned to this many, each time that `SPARE` more have come. Choice: 300 are
            no better, and a recall takes longer.
    """

    prior_knowledge = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE, PriorKnowledge.WORD_LIMIT})
    LENGTH = 0.6
    """The kernel's length, in registers. Tuned (wild worlds 3000-)."""
    DEPARTURE_VARIANCE = 0.05
    """Prior variance, in square image units, of what is not quadratic. Tuned (wild worlds 3000-)."""
    NOISE_PX = 0.7
    """Standard deviation of an image coordinate, in pixels: that of a good mark. Choice: wild worlds have
    0.5 px."""
    JACOBIAN_POINTS = 10
    """This many support points imply a Jacobian. Derived: a quadratic of three registers has ten
    coefficients."""
    SPARE = 30
    """This many more support points are kept before they are pruned. Choice: pruning takes time."""
    BLOCK = 16
    """So many support points are solved for at a time. Choice: as fast as any."""
    MOST_AVERAGED = 10
    """As many observations of one place count at most, as what is seen there may change. Choice."""
    SAME_PLACE = 1e-4
    """Registers that differ by no more are the same place. A guard: some 0.03 px."""
    ITERATIONS = 5
    """Gauss-Newton steps of a recall at most. Choice: they end when a step is within `SAME_PLACE`."""
    LONGEST_STEP = 0.5
    """One such step moves no register further. A guard against the quadratic's far side."""
    REGISTER_STD = 1.0
    """Prior deviation of one such step, in registers. Derived: a register ends at 1."""
    CONTRADICTION_SIGMAS = 3.0
    """What the four coordinates disagree by beyond this many standard deviations of noise is added to the
    deviation of a recall. Choice."""

    def __init__(self, motors: int, points: int = 200) -> None:
        self.points = check_number("points", points, least=10, whole=True)
        self.registers = np.empty((0, motors))
        self.sensors = np.empty((0, 2 * len(CAMERAS)))
        self.variances = np.empty((0, len(CAMERAS)))
        self._whitening = np.empty((len(CAMERAS), 0, 0))
        self._weights = np.empty((0, 2 * len(CAMERAS)))
        self._whitened = 0
        self._solved = True

    def __repr__(self) -> str:
        return f"GaussianProcess(points={self.points})"

    def recall(self, sensors: Array) -> Recall | None:
        """See `Knowledge`. Solves views(registers) = sensors by Gauss-Newton steps from the nearest point."""
        if not len(self.registers):
            return None
        self._solve()
        apart = self.sensors - sensors
        registers = self.registers[np.einsum("ij,ij->i", apart, apart).argmin()]
        weights = 1 / np.repeat(self.views(registers[None])[1][0] + self.noise, 2)
        for _ in range(self.ITERATIONS):
            view, jacobian = self._view_and_jacobian(registers)
            jt_w = jacobian.T * weights
            normal = jt_w @ jacobian
            normal.flat[:: len(registers) + 1] += 1 / self.REGISTER_STD**2
            step = np.linalg.solve(normal, jt_w @ (sensors - view))
            size = float(np.abs(step).max())
            registers = np.clip(registers + step * min(1.0, self.LONGEST_STEP / max(size, 1e-12)), -1, 1)
            if size < self.SAME_PLACE:
                break
        (view,), (variances,) = self.views(registers[None])
        squares = np.square(sensors - view).reshape(len(CAMERAS), 2).sum(1)
        variances = variances + np.maximum(0, squares - self.CONTRADICTION_SIGMAS**2 * self.noise)
        return Recall(registers, float(np.sqrt(variances.max())) / IMAGE_UNIT)

    def views(self, registers: Array) -> tuple[Array, Array]:
        """What should be seen at registers (k, m): sensors (k, 4), and variances in each camera (k, 2)."""
        self._solve()
        kernel = self._kernel(registers, self.registers)
        return kernel @ self._weights, self._variances(kernel, registers)

    def jacobian(self, registers: Array) -> Array | None:
        """See `Knowledge`."""
        self._solve()
        enough = len(self.registers) >= self.JACOBIAN_POINTS
        return self._view_and_jacobian(registers)[1] if enough else None

    def learn(self, sensors: Array, registers: Array) -> None:
        """See `Knowledge`. What is seen at the same registers again is averaged."""
        noise = np.full(len(CAMERAS), self.noise)
        apart = np.abs(self.registers - registers).max(1, initial=0.0)
        if len(apart) and apart.min() < self.SAME_PLACE:
            same = int(apart.argmin())
            self.sensors, self.variances = self.sensors.copy(), self.variances.copy()
            share = self.variances[same] / (self.variances[same] + noise)
            self.sensors[same] += np.repeat(share, 2) * (sensors - self.sensors[same])
            variances = np.maximum(self.variances[same] * (1 - share), self.noise / self.MOST_AVERAGED)
            if (variances != self.variances[same]).any():
                self.variances[same] = variances
                self._whitened = min(self._whitened, same)
        else:
            self.registers = np.concatenate([self.registers, [registers]])
            self.sensors = np.concatenate([self.sensors, [sensors]])
            self.variances = np.concatenate([self.variances, [noise]])
        self._solved = False
        if len(self.registers) > self.points + self.SPARE:
            self._prune()

    def map(self, change: Change, deviation_px: NDArray[np.float64]) -> None:
        """See `Knowledge`."""
        if len(self.registers):
            self.sensors, self.registers = change(self.sensors, self.registers)
            self.variances = self.variances + (deviation_px * IMAGE_UNIT) ** 2
            self._whitened, self._solved = 0, False

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `Knowledge`."""
        return {"registers": self.registers, "sensors": self.sensors, "variances": self.variances}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `Knowledge`."""
        registers = checked_array(arrays, "registers", (None, self.registers.shape[1]))
        sensors = checked_array(arrays, "sensors", (len(registers), 2 * len(CAMERAS)))
        variances = checked_array(arrays, "variances", (len(registers), len(CAMERAS)))
        self.registers, self.sensors, self.variances = registers, sensors, variances
        self._whitened, self._solved = 0, False

    @property
    def noise(self) -> float:
        """Variance of what is seen in a camera, in square image units."""
        return (self.NOISE_PX * IMAGE_UNIT) ** 2

    def _kernel(self, places: Array, others: Array) -> Array:
        """Prior covariance (k, n) of what is seen at `places` (k, m) and at `others` (n, m)."""
        products = places @ others.T / self.LENGTH**2
        squares = np.einsum("ij,ij->i", others, others) / self.LENGTH**2
        apart = squares + (np.einsum("ij,ij->i", places, places) / self.LENGTH**2)[:, None] - 2 * products
        return np.asarray((1 + products) ** 2 + self.DEPARTURE_VARIANCE * np.exp(-apart / 2))

    def _view_and_jacobian(self, registers: Array) -> tuple[Array, Array]:
        products = self.registers @ registers / self.LENGTH**2
        apart = registers - self.registers
        near = self.DEPARTURE_VARIANCE * np.exp(np.einsum("ij,ij->i", apart, apart) / (-2 * self.LENGTH**2))
        view = ((1 + products) ** 2 + near) @ self._weights
        slopes = 2 * (1 + products)[:, None] * self.registers - near[:, None] * apart
        return view, self._weights.T @ slopes / self.LENGTH**2

    def _variances(self, kernel: Array, registers: Array) -> Array:
        """Posterior variance (k, 2) of what is seen at registers (k, m), from their kernel (k, n)."""
        prior = (1 + np.square(registers).sum(1) / self.LENGTH**2) ** 2 + self.DEPARTURE_VARIANCE
        known = np.transpose([np.square(kernel @ whitening.T).sum(1) for whitening in self._whitening])
        return np.maximum(prior[:, None] - np.broadcast_to(known, (len(prior), len(CAMERAS))), 0.0)

    def _prune(self) -> None:
        """Drops, one after the other, the support points that add least to the others."""
        self._solve()
        inverses, kept = self._whitening.swapaxes(1, 2) @ self._whitening, np.ones(len(self.registers), bool)
        for _ in range(len(kept) - self.points):
            redundant = np.einsum("cii,ic->i", inverses, self.variances)
            index = int(np.where(kept, redundant, -np.inf).argmax())
            column = inverses[:, index]
            inverses -= column[:, :, None] * (column / column[:, [index]])[:, None]
            kept[index] = False
        self.registers, self.sensors, self.variances = (
            values[kept] for values in (self.registers, self.sensors, self.variances)
        )
        self._whitened, self._solved = int(kept.argmin()), False

    def _solve(self) -> None:
        """Solves for the weights of the support points, where any has changed since."""
        if not self._solved:
            self._whiten()
            seen = self.sensors.reshape(-1, len(CAMERAS), 2).swapaxes(0, 1)
            self._weights = np.concatenate([*(self._whitening.swapaxes(1, 2) @ (self._whitening @ seen))], 1)
            self._solved = True

    def _whiten(self) -> None:
        """Inverts the Cholesky factors of both cameras' covariances, in blocks behind those that still hold.

        Where each point is as noisy in both, one inverse serves both.
        Blocks begin at multiples of `BLOCK`: so rounding does not depend on what was solved before.
        """
        size, known = len(self.registers), self._whitened // self.BLOCK * self.BLOCK
        alike = (self.variances[:, 0] == self.variances[:, 1]).all()
        cameras = 1 if alike else len(CAMERAS)
        whitening = np.zeros((cameras, size, size))
        whitening[:, :known, :known] = self._whitening[:cameras, :known, :known]
        for begin in range(known, size, self.BLOCK):
            block = slice(begin, begin + self.BLOCK)
            before, noise = whitening[:, :begin, :begin], self.variances[block].T[:cameras]
            kernel = self._kernel(self.registers[block], self.registers[: block.stop])
            factor = kernel[:, :begin] @ before.swapaxes(1, 2)
            own = kernel[:, begin:] + np.eye(noise.shape[1]) * noise[:, None]
            corner = np.linalg.inv(np.linalg.cholesky(own - factor @ factor.swapaxes(1, 2)))
            whitening[:, block, block] = corner
            whitening[:, block, :begin] = -corner @ factor @ before
        self._whitening, self._whitened = whitening, size
