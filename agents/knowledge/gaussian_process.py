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

from agents.base.agent import Array
from agents.base.checks import check_whole, fitting
from agents.knowledge.interface import Change, Recall
from calfree_gym.image import IMAGE_UNIT

CAMERAS = 2


class GaussianProcess:
    """Each camera's image points (2,) as a Gaussian process over registers (m,), read backwards to recall.

    The kernel is that of a quadratic whose coefficients are unknown, and of smooth departures from it. Each
    support point has its own noise in each camera: so what was mapped with doubt weighs less than what was
    seen. Where there are too many, those that add least to what the others tell are dropped.

    Attributes:
        registers: Of the support points (n, m).
        sensors: What is seen there (n, 4), in image units.
        variances: Of the noise in each camera (n, 2), in square image units.

    Args:
        motors: Number of registers m.
        points: Support points are pruned to so many, each time that `SPARE` more have come.
    """

    REACH = 0.6
    """Registers are divided by this: the kernel's length."""
    DEPARTURE = 0.05
    """Prior variance, in square image units, of what is not quadratic."""
    NOISE_PX = 0.7
    ENOUGH = 10
    """So many support points imply a Jacobian: a quadratic has ten coefficients."""
    SPARE = 30
    """So many more support points are kept before they are pruned."""
    MOST = 10
    """As many looks at one place count at most: what is seen there may change."""
    SAME = 1e-4
    """Registers that differ by no more are the same place."""
    ITERATIONS = 5
    STEP = 0.5

    def __init__(self, motors: int, points: int = 200) -> None:
        self.points = check_whole("points", points, least=10)
        self.registers = np.empty((0, motors))
        self.sensors = np.empty((0, 2 * CAMERAS))
        self.variances = np.empty((0, CAMERAS))
        self._inverses = np.empty((CAMERAS, 0, 0))
        self._settled = True
        self._weights = np.empty((0, 2 * CAMERAS))

    def __repr__(self) -> str:
        return f"GaussianProcess(points={self.points})"

    def recall(self, sensors: Array) -> Recall | None:
        """See `Knowledge`. Solves views(registers) = sensors by Gauss-Newton steps from the nearest point."""
        if not len(self.registers):
            return None
        self._settle()
        apart = self.sensors - sensors
        registers = self.registers[np.einsum("ij,ij->i", apart, apart).argmin()]
        weights = 1 / np.repeat(self.views(registers[None])[1][0] + self.noise, 2)
        for _ in range(self.ITERATIONS):
            view, jacobian = self._view_and_jacobian(registers)
            pulled = jacobian.T * weights
            normal = pulled @ jacobian
            normal.flat[:: len(registers) + 1] += 1.0
            step = np.linalg.solve(normal, pulled @ (sensors - view))
            size = float(np.abs(step).max())
            registers = np.clip(registers + step * min(1.0, self.STEP / max(size, 1e-12)), -1, 1)
            if size < self.SAME:
                break
        (view,), (variances,) = self.views(registers[None])
        missed = np.square(sensors - view).reshape(CAMERAS, 2).sum(1)
        variances = variances + np.maximum(0, missed - 9 * self.noise)
        return Recall(registers, float(np.sqrt(variances.max())) / IMAGE_UNIT)

    def views(self, registers: Array) -> tuple[Array, Array]:
        """What should be seen at registers (k, m): sensors (k, 4), and variances in each camera (k, 2)."""
        self._settle()
        kernel = self._kernel(registers)
        return kernel @ self._weights, self._variances(kernel, registers)

    def jacobian(self, registers: Array) -> Array | None:
        """See `Knowledge`."""
        self._settle()
        enough = len(self.registers) >= self.ENOUGH
        return self._view_and_jacobian(registers)[1] if enough else None

    def learn(self, sensors: Array, registers: Array) -> None:
        """See `Knowledge`. What is seen at the same registers again is averaged."""
        noise = np.full(CAMERAS, self.noise)
        apart = np.abs(self.registers - registers).max(1, initial=0.0)
        if len(apart) and apart.min() < self.SAME:
            same = int(apart.argmin())
            self.sensors, self.variances = self.sensors.copy(), self.variances.copy()
            share = self.variances[same] / (self.variances[same] + noise)
            self.sensors[same] += np.repeat(share, 2) * (sensors - self.sensors[same])
            self.variances[same] = np.maximum(self.variances[same] * (1 - share), self.noise / self.MOST)
        else:
            self.registers = np.concatenate([self.registers, [registers]])
            self.sensors = np.concatenate([self.sensors, [sensors]])
            self.variances = np.concatenate([self.variances, [noise]])
        self._settled = False
        if len(self.registers) > self.points + self.SPARE:
            self._prune()

    def map(self, change: Change, deviation_px: NDArray[np.float64]) -> None:
        """See `Knowledge`."""
        if len(self.registers):
            self.sensors, self.registers = change(self.sensors, self.registers)
            self.variances = self.variances + (deviation_px * IMAGE_UNIT) ** 2
            self._settled = False

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `Knowledge`."""
        return {"registers": self.registers, "sensors": self.sensors, "variances": self.variances}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `Knowledge`."""
        registers = fitting(arrays, "registers", (None, self.registers.shape[1]))
        sensors = fitting(arrays, "sensors", (len(registers), 2 * CAMERAS))
        variances = fitting(arrays, "variances", (len(registers), CAMERAS))
        self.registers, self.sensors, self.variances = registers, sensors, variances
        self._settled = False

    @property
    def noise(self) -> float:
        """Variance of what is seen in a camera, in square image units."""
        return (self.NOISE_PX * IMAGE_UNIT) ** 2

    def _kernel(self, places: Array) -> Array:
        """Prior covariance (k, n) of what is seen at `places` (k, m) and at the support points."""
        products = places @ self.registers.T / self.REACH**2
        squares = np.einsum("ij,ij->i", self.registers, self.registers) / self.REACH**2
        apart = squares + (np.einsum("ij,ij->i", places, places) / self.REACH**2)[:, None] - 2 * products
        return np.asarray((1 + products) ** 2 + self.DEPARTURE * np.exp(-apart / 2))

    def _view_and_jacobian(self, registers: Array) -> tuple[Array, Array]:
        products = self.registers @ registers / self.REACH**2
        apart = registers - self.registers
        near = self.DEPARTURE * np.exp(np.einsum("ij,ij->i", apart, apart) / (-2 * self.REACH**2))
        view = ((1 + products) ** 2 + near) @ self._weights
        slopes = 2 * (1 + products)[:, None] * self.registers - near[:, None] * apart
        return view, self._weights.T @ slopes / self.REACH**2

    def _variances(self, kernel: Array, registers: Array) -> Array:
        """Posterior variance (k, 2) of what is seen at registers (k, m), from their kernel (k, n)."""
        prior = (1 + np.square(registers).sum(1) / self.REACH**2) ** 2 + self.DEPARTURE
        known = [np.einsum("kn,kn->k", kernel @ inverse, kernel) for inverse in self._inverses]
        return np.maximum(prior[:, None] - np.transpose(known), 0.0)

    def _prune(self) -> None:
        """Drops, one after the other, the support points that add least to what the others tell."""
        self._settle()
        inverses, kept = self._inverses, np.arange(len(self.registers))
        while len(kept) > self.points:
            redundant = np.einsum("cii,ic->i", inverses, self.variances[kept])
            index = int(redundant.argmax())
            column = inverses[:, index]
            inverses = inverses - column[:, :, None] * (column / column[:, [index]])[:, None]
            inverses = np.delete(np.delete(inverses, index, 1), index, 2)
            kept = np.delete(kept, index)
        self.registers, self.sensors, self.variances = (
            values[kept] for values in (self.registers, self.sensors, self.variances)
        )
        self._settled = False

    def _settle(self) -> None:
        """Solves for what was learned since it was last asked."""
        if not self._settled:
            kernel = self._kernel(self.registers)
            alike = (self.variances[:, 0] == self.variances[:, 1]).all()
            cameras = self.variances.T[:1] if alike else self.variances.T
            inverses = np.array([np.linalg.inv(kernel + np.diag(own)) for own in cameras])
            self._inverses = np.broadcast_to(inverses, (CAMERAS, *kernel.shape))
            seen = self.sensors.reshape(-1, CAMERAS, 2).swapaxes(0, 1)
            self._weights = np.concatenate([*(self._inverses @ seen)], 1)
            self._settled = True
