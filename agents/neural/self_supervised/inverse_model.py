"""A network that says by which control words the image distance changes as is wanted."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from agents.base.checks import check_number, check_numbers, checked_array
from agents.base.observation import Array
from agents.neural.self_supervised.replay import SENSORS, Pairs

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

    AVERAGING = 0.99
    """The weights that act are an exponential average of the trained ones over some 1 / (1 - 0.99) updates
    (Polyak & Juditsky 1992)."""
    SMALL_CHANGE = 0.06
    """Errors of words are relative to the change of d, and to no smaller one than this share of
    `image_scale`: smaller ones say little of a reach."""

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
        widths = (inputs, *hidden)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            layers: list[nn.Module] = []
            for wide, next_wide in pairwise(widths):
                layers += [nn.Linear(wide, next_wide), nn.SiLU()]
            layers.append(nn.Linear(widths[-1], motors * DISTANCE if matrix else motors))
        self._network = nn.Sequential(*layers)
        self._averaged = copy.deepcopy(self._network).requires_grad_(False)
        self._adam = torch.optim.Adam(self._network.parameters(), lr=learning_rate, fused=True)
        self._weights = [*zip(self._averaged.parameters(), self._network.parameters(), strict=True)]
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
        with torch.no_grad():
            outputs = self._said(self._averaged, *self._inputs(sensors, registers, change))
        return np.asarray(outputs.numpy() * self.register_scale, float)

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
        inputs, wanted = self._inputs(pairs.sensors, pairs.registers, pairs.change)
        made = torch.from_numpy(np.float32(pairs.words / self.register_scale))
        relative = torch.from_numpy(np.float32(1 / self._size(pairs.change)))
        doubtful = torch.from_numpy(pairs.doubtful)
        batches = (each.tensor_split(steps) for each in (inputs, wanted, made, relative, doubtful))
        for batch, change, words, weights, old in zip(*batches, strict=True):
            errors = (self._said(self._network, batch, change) - words).square().sum(1) * weights
            if old.any():
                confirmed = usual_error**2 / (usual_error**2 + errors.detach())
                errors = torch.where(old, confirmed * errors, errors)
            self._adam.zero_grad()
            errors.mean().backward()
            self._adam.step()
            for average, latest in self._weights:
                average.lerp_(latest.detach(), 1 - self.AVERAGING)

    def _size(self, change: Array) -> Array:
        """Squared lengths (n,) of changes of d, relative to the image scale, and never very small."""
        return np.asarray(np.square(change / self.image_scale).sum(1) + self.SMALL_CHANGE**2)

    def _inputs(self, sensors: Array, registers: Array, change: Array) -> tuple[Tensor, Tensor]:
        """The network's inputs (n, k), and among them the wanted changes (n, 4), all relative."""
        wanted = change / self.image_scale
        inputs = [wanted, (sensors - self._center) / self.image_scale]
        if self._knows_registers:
            inputs.append(registers / self.register_scale)
        joined = torch.from_numpy(np.concatenate(inputs, 1, dtype=np.float32))
        return joined, joined[:, :DISTANCE]

    def _said(self, network: nn.Module, inputs: Tensor, wanted: Tensor) -> Tensor:
        """Words (n, m), relative to `register_scale`, that a network says for its inputs."""
        outputs: Tensor = network(inputs)
        if not self._matrix:
            return outputs
        return (outputs.view(-1, self.motors, DISTANCE) @ wanted[:, :, None])[:, :, 0]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Weights, averaged weights, Adam's moments and scales, by name."""
        weights = list(self._network.parameters())
        moments = [self._adam.state.get(each, {}) for each in weights]

        def flat(name: str) -> Tensor:
            return parameters_to_vector(
                [m.get(name, torch.zeros_like(w)) for m, w in zip(moments, weights, strict=True)]
            )

        return {
            "weights": parameters_to_vector(weights).detach().numpy().copy(),
            "averaged": parameters_to_vector(self._averaged.parameters()).numpy().copy(),
            "first_moments": flat("exp_avg").numpy().copy(),
            "second_moments": flat("exp_avg_sq").numpy().copy(),
            "updates": np.array(float(moments[0].get("step", 0.0))),
            "center": self._center.copy(),
            "image_scale": np.array(self.image_scale),
            "register_scale": self.register_scale.copy(),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: An array is missing, damaged or of another shape.
        """
        weights = list(self._network.parameters())
        size = (sum(each.numel() for each in weights),)
        names = ("weights", "averaged", "first_moments", "second_moments")
        flat = {name: torch.from_numpy(np.float32(checked_array(arrays, name, size))) for name in names}
        updates = float(checked_array(arrays, "updates", ()))
        center = checked_array(arrays, "center", (SENSORS,))
        image_scale = float(checked_array(arrays, "image_scale", ()))
        register_scale = checked_array(arrays, "register_scale", (self.motors,))
        vector_to_parameters(flat["weights"], weights)
        vector_to_parameters(flat["averaged"], self._averaged.parameters())
        places = np.cumsum([each.numel() for each in weights])[:-1].tolist()
        first, second = (torch.tensor_split(flat[name], places) for name in names[2:])
        self._adam.state.clear()
        for weight, mean, square in zip(weights, first, second, strict=True):
            if updates:
                self._adam.state[weight] = {
                    "step": torch.tensor(updates),
                    "exp_avg": mean.view_as(weight).clone(),
                    "exp_avg_sq": square.view_as(weight).clone(),
                }
        self._center, self.image_scale, self.register_scale = center, image_scale, register_scale
