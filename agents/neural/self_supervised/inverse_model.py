"""A network that says by which control words the image distance changes as is wanted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.checks import check_number, check_numbers, checked_array
from ...base.observation import Array
from .perceptron import Float32, Perceptron
from .replay import SENSORS, Pairs

DISTANCE = 4
"""Length of the image distance d."""


class InverseModel:
    """Words (m,) for a state and a wanted change of the image distance d, by a multi-layer perceptron.

    All lengths are relative to how far points and registers spread on the robot's first motions, so that no
    constant here depends on the unit of an image point or on the strength of a motor.

    Attributes:
        image_scale: Standard deviation of the image points on the first motions; 0 before them.
        register_scale: Root mean square of the registers on the first motions, for each motor (m,); negative
            for one that has reversed since.

    Args:
        motors: m.
        seed: Of the first weights.
        hidden: Widths of the hidden layers.
        learning_rate: Of Adam (Kingma & Ba 2015).
        matrix: Whether the network puts out a matrix M (m, 4), and the words are M Δd; otherwise the words
            themselves.
        knows_registers: Whether registers are among its inputs.
    """

    SMALL_CHANGE = 0.06
    """Errors of words are relative to the change of d, and to no smaller one than this share of
    `image_scale`. Choice: smaller ones say little of a reach."""

    def __init__(
        self,
        motors: int,
        seed: int,
        hidden: tuple[int, ...],
        learning_rate: float,
        matrix: bool,
        knows_registers: bool,
    ) -> None:
        check_numbers("hidden", hidden, least=1, whole=True)
        check_number("learning_rate", learning_rate, above=0)
        self.motors = motors
        self._described = f"hidden={tuple(hidden)}, learning_rate={learning_rate:g}"
        self._matrix, self._knows_registers = matrix, knows_registers
        inputs = SENSORS + DISTANCE + motors * knows_registers
        outputs = motors * DISTANCE if matrix else motors
        self._network = Perceptron((inputs, *hidden, outputs), learning_rate, seed)
        self._center = np.zeros(SENSORS)
        self.image_scale = 0.0
        self.register_scale = np.ones(motors)

    def __repr__(self) -> str:
        return f"InverseModel({self._described}, {self.motors} motors)"

    @property
    def ready(self) -> bool:
        """Whether the scales are known, so that it can be trained and asked."""
        return self.image_scale > 0

    def set_scales(self, sensors: Array, registers: Array) -> None:
        """Takes center and scales from first observations: sensor vectors (n, 8) and registers (n, m)."""
        self._center = sensors.mean(0)
        self.image_scale = float(np.sqrt(sensors.var(0).mean()))
        self.register_scale = np.full(self.motors, np.sqrt(np.square(registers).mean()))

    def reverse(self, signs: Array) -> None:
        """Takes all that was learned for true once more, with other signs (m,) of words and registers."""
        self.register_scale = self.register_scale * signs

    def words(self, sensors: Array, registers: Array, change: Array) -> Array:
        """Words (n, m) that change the image distance by `change` (n, 4), as the averaged weights say.

        Args:
            sensors: Both sensor vectors (n, 8) before.
            registers: Before (n, m).
            change: Of the image distance (n, 4).
        """
        inputs = self._inputs(sensors, registers, change)
        return self._said(self._network(inputs), inputs) * self.register_scale

    def judge(self, pairs: Pairs) -> tuple[Array, Array, Array]:
        """What the network says of pairs of observations.

        Returns:
            Words made (n, m) and words said for the changes seen (n, m), relative to `register_scale`, and
            lengths (n,) of these changes.
        """
        said = self.words(pairs.sensors, pairs.registers, pairs.change) / self.register_scale
        return pairs.words / self.register_scale, said, np.sqrt(self._size(pairs.change))

    def train(self, pairs: Pairs, steps: int, usual_error: float) -> None:
        """Steps of Adam on pairs of observations, and of the averaged weights behind them.

        Args:
            pairs: They are divided among the steps. A doubtful one counts as far as the network confirms it,
                by Cauchy's weight.
            steps: How many.
            usual_error: A doubtful pair with this error has half of its weight.
        """
        if len(pairs.words) < steps:
            return
        inputs = self._inputs(pairs.sensors, pairs.registers, pairs.change)
        made = np.float32(pairs.words / self.register_scale)
        relative = np.float32(1 / self._size(pairs.change))
        usual = np.float32(usual_error**2)
        batches = (np.array_split(each, steps) for each in (inputs, made, relative, pairs.doubtful))
        for batch, words, weights, old in zip(*batches, strict=True):
            passed = self._network.forward(batch)
            residuals = self._said(passed.outputs, batch) - words
            if old.any():
                errors = np.square(residuals).sum(1) * weights
                weights = np.where(old, weights * usual / (usual + errors), weights)
            slopes = residuals * weights[:, None] * np.float32(2 / len(batch))
            self._network.descend(passed, self._by_outputs(slopes, batch))

    def _size(self, change: Array) -> Array:
        """Squared lengths (n,) of changes of d, relative to the image scale, and never very small."""
        return np.asarray(np.square(change / self.image_scale).sum(1) + self.SMALL_CHANGE**2)

    def _inputs(self, sensors: Array, registers: Array, change: Array) -> Float32:
        """The network's inputs (n, i), all relative: the wanted change of d comes first."""
        inputs = [change / self.image_scale, (sensors - self._center) / self.image_scale]
        if self._knows_registers:
            inputs.append(registers / self.register_scale)
        return np.concatenate(inputs, 1, dtype=np.float32)

    def _said(self, outputs: Float32, inputs: Float32) -> Float32:
        """Words (n, m), relative to `register_scale`, by the network's outputs for its inputs."""
        if not self._matrix:
            return outputs
        matrices = outputs.reshape(-1, self.motors, DISTANCE)
        return np.asarray((matrices * inputs[:, None, :DISTANCE]).sum(2))

    def _by_outputs(self, slopes: Float32, inputs: Float32) -> Float32:
        """How something changes with the network's outputs (n, k), from how it does with words (n, m)."""
        if not self._matrix:
            return slopes
        return (slopes[:, :, None] * inputs[:, None, :DISTANCE]).reshape(len(slopes), -1)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Weights, averaged weights, Adam's moments and scales, by name."""
        return {
            **self._network.arrays(),
            "center": self._center.copy(),
            "image_scale": np.array(self.image_scale),
            "register_scale": self.register_scale.copy(),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: An array is missing, damaged or of another shape.
        """
        center = checked_array(arrays, "center", (SENSORS,))
        image_scale = float(checked_array(arrays, "image_scale", ()))
        register_scale = checked_array(arrays, "register_scale", (self.motors,))
        self._network.restore(arrays)
        self._center, self.image_scale, self.register_scale = center, image_scale, register_scale
