"""A small network in NumPy: with a few thousand weights, PyTorch takes more than twice as long for a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.checks import checked_array

Float32 = NDArray[np.float32]


class ForwardPass(NamedTuple):
    """What weights make of inputs.

    Attributes:
        outputs: Of the network (n, k).
        values: What goes into each layer, the inputs first.
        slopes: Of the units between two layers.
    """

    outputs: Float32
    values: list[Float32]
    slopes: list[Float32]


class Perceptron:
    """A multi-layer perceptron with SiLU units, trained by Adam (Kingma & Ba 2015), with averaged weights.

    Attributes:
        weights: All trained weights and biases in one vector (w,): those of the first layer first.
        averaged: An exponential average (w,) of the trained ones (Polyak & Juditsky 1992): these act.

    Args:
        widths: Of inputs, hidden layers and outputs.
        learning_rate: Of Adam.
        seed: Of the first weights, uniform within ± 1 / √(inputs of a unit).
    """

    AVERAGING = 0.99
    """The average is over some 1 / (1 - 0.99) steps."""
    MEAN_DECAY, SQUARE_DECAY, LEAST_ROOT = 0.9, 0.999, 1e-8
    """Of Adam, as its authors give them."""

    def __init__(self, widths: Sequence[int], learning_rate: float, seed: int) -> None:
        self._widths, self._learning_rate = tuple(widths), learning_rate
        rng = np.random.default_rng(seed)
        bounds = [
            np.full((wide + 1) * next_wide, 1 / np.sqrt(wide)) for wide, next_wide in pairwise(self._widths)
        ]
        bound = np.concatenate(bounds)
        self.weights: Float32 = rng.uniform(-bound, bound).astype(np.float32)
        self.averaged = self.weights.copy()
        self._gradient = np.zeros_like(self.weights)
        self._mean, self._square = np.zeros_like(self.weights), np.zeros_like(self.weights)
        self._steps = 0

    def __call__(self, inputs: Float32) -> Float32:
        """Outputs (n, k) of the averaged weights for inputs (n, i)."""
        return self._forward(self.averaged, inputs).outputs

    def forward(self, inputs: Float32) -> ForwardPass:
        """What the trained weights make of inputs (n, i)."""
        return self._forward(self.weights, inputs)

    def _forward(self, weights: Float32, inputs: Float32) -> ForwardPass:
        *hidden, (matrix, bias) = self._layers(weights)
        values, slopes = [inputs], []
        for each, its_bias in hidden:
            value, slope = _silu(values[-1] @ each.T + its_bias)
            values.append(value)
            slopes.append(slope)
        return ForwardPass(values[-1] @ matrix.T + bias, values, slopes)

    def descend(self, passed: ForwardPass, gradient: Float32) -> None:
        """One step of Adam, and of the averaged weights behind it.

        Args:
            passed: What the weights, as they are, make of a batch.
            gradient: How the loss changes with each of its outputs (n, k).
        """
        self._propagate_back(passed, gradient)
        self._steps += 1
        self._mean += (1 - self.MEAN_DECAY) * (self._gradient - self._mean)
        self._square += (1 - self.SQUARE_DECAY) * (np.square(self._gradient) - self._square)
        root = np.sqrt(self._square / (1 - self.SQUARE_DECAY**self._steps)) + self.LEAST_ROOT
        self.weights -= self._learning_rate / (1 - self.MEAN_DECAY**self._steps) * self._mean / root
        self.averaged += (1 - self.AVERAGING) * (self.weights - self.averaged)

    def _propagate_back(self, passed: ForwardPass, gradient: Float32) -> None:
        """Fills in how the loss changes with each weight."""
        layers = zip(self._layers(self.weights), self._layers(self._gradient), strict=True)
        for i, ((matrix, _), (by_matrix, by_bias)) in reversed([*enumerate(layers)]):
            np.matmul(gradient.T, passed.values[i], out=by_matrix)
            gradient.sum(0, out=by_bias)
            if i:
                gradient = (gradient @ matrix) * passed.slopes[i - 1]

    def _layers(self, vector: Float32) -> list[tuple[Float32, Float32]]:
        """The parts of a vector (w,) that are the matrix (outputs, inputs) and bias of each layer."""
        layers, begin = [], 0
        for wide, next_wide in pairwise(self._widths):
            middle = begin + wide * next_wide
            end = middle + next_wide
            layers.append((vector[begin:middle].reshape(next_wide, wide), vector[middle:end]))
            begin = end
        return layers

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Weights, averaged weights and Adam's moments, by name."""
        return {
            "weights": self.weights.copy(),
            "averaged": self.averaged.copy(),
            "first_moments": self._mean.copy(),
            "second_moments": self._square.copy(),
            "updates": np.array(float(self._steps)),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: An array is missing, damaged or of another shape.
        """
        names = ("weights", "averaged", "first_moments", "second_moments")
        vectors = [checked_array(arrays, name, self.weights.shape).astype(np.float32) for name in names]
        self._steps = int(checked_array(arrays, "updates", ()))
        self.weights, self.averaged, self._mean, self._square = vectors


def _silu(sums: Float32) -> tuple[Float32, Float32]:
    """SiLU of sums (n, k), x σ(x), and its slope."""
    share = 0.5 + 0.5 * np.tanh(0.5 * sums)
    values = sums * share
    return values, share + values * (1 - share)
