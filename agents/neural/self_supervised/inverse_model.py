"""A network that says by which control words the image distance changes as is wanted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.checks import check_number, check_numbers, checked_array
from ...base.observation import Array, Observation

SENSORS = 8
"""Length of both sensor vectors, the gripper's and the object's."""
FARTHEST = 1e4
"""Of saved image points and registers, in any unit. Choice: no camera has more pixels."""


class ReplayPairs(NamedTuple):
    """Ordered pairs of observations of the same trial.

    Attributes:
        sensors: The gripper's and the object's sensor vectors (n, 8) in the first one.
        registers: Of the first one (n, m).
        change: How the image distance d changed to the second one (n, 4).
        words: By which words (n, m), in sum, the robot came from the first one to the second.
        doubtful: Which of them (n,) are from before a change of the world.
    """

    sensors: Array
    registers: Array
    change: Array
    words: Array
    doubtful: NDArray[np.bool_]

    @classmethod
    def of(cls, before: Observation, after: Observation) -> ReplayPairs:
        """The pair (n = 1) of two observations."""
        return cls(
            sensors=before.points.reshape(1, SENSORS),
            registers=before.registers[None],
            change=(after.distance - before.distance)[None],
            words=(after.registers - before.registers)[None],
            doubtful=np.zeros(1, bool),
        )


class Replay:
    """The latest observations in which all points were seen, trial by trial.

    Attributes:
        capacity: How many observations are kept at most.
        added: How many it has ever been given.
    """

    ENOUGH_NEW = 40
    """After a change of the world half of the pairs drawn are new once there are so many new observations: as
    many as a new robot begins to learn from."""

    def __init__(self, motors: int, capacity: int) -> None:
        self.capacity = capacity
        self._sensors = np.zeros((0, SENSORS))
        self._registers = np.zeros((0, motors))
        self._trials = np.zeros(0, np.int64)
        self._first = self._size = 0
        self._doubtful = 0
        self.added = 0

    def __len__(self) -> int:
        return self._size - self._first

    @property
    def sensors(self) -> Array:
        """All sensor vectors (n, 8) that it holds: gripper's, object's."""
        return self._sensors[self._first : self._size]

    @property
    def registers(self) -> Array:
        """All registers (n, m) that it holds."""
        return self._registers[self._first : self._size]

    @property
    def trials(self) -> NDArray[np.int64]:
        """In which trial each observation was made (n,), ascending."""
        return self._trials[self._first : self._size]

    def add(self, observation: Observation, trial: int) -> None:
        """Keeps an observation of a trial, unless a point was out of view in it."""
        if not observation.visible.all():
            return
        if self._size == len(self._sensors):
            self._make_room()
        self._sensors[self._size] = observation.points.reshape(SENSORS)
        self._registers[self._size] = observation.registers
        self._trials[self._size] = trial
        self._size += 1
        self.added += 1
        self._first = max(self._first, self._size - self.capacity)
        self._doubtful = max(self._doubtful, self._first)

    def doubt(self, added: int) -> None:
        """Takes all but what was added since `added` for doubtful: it is from before a change of the world.

        A trial that spans the change becomes two: no pair of observations spans it.
        """
        self._doubtful = max(self._first, self._size - (self.added - added))
        self._trials[self._doubtful : self._size] += 1

    def reverse(self, signs: Array, added: int) -> None:
        """Gives the registers of all but what was added since `added` other signs (m,), as `doubt` splits."""
        before = slice(self._first, max(self._first, self._size - (self.added - added)))
        self._registers[before] *= signs
        self._trials[before.stop : self._size] += 1

    def sample(self, count: int, rng: np.random.Generator, consecutive: bool = False) -> ReplayPairs:
        """Draws pairs: a first observation, and another one of the same trial, uniformly.

        Where most are doubtful, half of the first ones are not, or less while these are few.

        Args:
            count: How many to draw; those whose first observation has no partner are left out.
            rng: Draws them.
            consecutive: Whether the other one is the next one; otherwise it is any, before or after.

        Returns:
            The pairs; there may be none.
        """
        sensors, registers, trials = self.sensors, self.registers, self.trials
        first = self._draw(count, rng)
        begin = np.searchsorted(trials, trials[first], "left")
        end = np.searchsorted(trials, trials[first], "right")
        if consecutive:
            begin, end = first, np.minimum(end, first + 2)
        others = end - begin - 1
        first, begin, others = (each[others > 0] for each in (first, begin, others))
        second = begin + (first - begin + 1 + rng.integers(others)) % (others + 1)
        change = sensors[second] - sensors[first]
        return ReplayPairs(
            sensors[first],
            registers[first],
            change[:, :4] - change[:, 4:],
            registers[second] - registers[first],
            first < self._doubtful - self._first,
        )

    def _draw(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Indices (n,) of observations."""
        old, size = self._doubtful - self._first, len(self)
        drawn = rng.integers(size, size=count)
        if not size / 2 < old < size:
            return drawn
        share = min(1.0, (size - old) / self.ENOUGH_NEW) / 2
        new = rng.random(count) < share
        return np.where(new, rng.integers(old, size, count), rng.integers(old, size=count))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it holds, by name."""
        return {
            "sensors": self.sensors.copy(),
            "registers": self.registers.copy(),
            "trials": self.trials.copy(),
            "doubtful": np.array(self._doubtful - self._first),
            "added": np.array(self.added),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: An array is missing, damaged or of another shape.
        """
        sensors = checked_array(arrays, "sensors", (None, SENSORS), most=FARTHEST)
        registers = checked_array(
            arrays, "registers", (len(sensors), self._registers.shape[1]), most=FARTHEST
        )
        trials = checked_array(arrays, "trials", (len(sensors),), least=0, whole=True).astype(np.int64)
        if (np.diff(trials) < 0).any():
            raise ValueError("the saved trials do not ascend")
        doubtful = int(checked_array(arrays, "doubtful", (), least=0, most=len(sensors), whole=True))
        self.added = int(checked_array(arrays, "added", (), least=len(sensors), whole=True))
        self._sensors, self._registers, self._trials = sensors, registers, trials
        self._first, self._size, self._doubtful = 0, len(sensors), doubtful

    def _make_room(self) -> None:
        """Moves what is kept to the front of arrays that are twice as long."""
        kept, self._doubtful = len(self), self._doubtful - self._first
        for name in ("_sensors", "_registers", "_trials"):
            old = getattr(self, name)
            new = np.zeros((2 * kept + 64, *old.shape[1:]), old.dtype)
            new[:kept] = old[self._first : self._size]
            setattr(self, name, new)
        self._first, self._size = 0, kept


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
    MOST = 1e4
    """Of a saved weight. Choice: trained ones are of the order of 1."""
    MOST_ROOTS = 10.0
    """Of a saved moment. Derived: by Adam's decays a first one is at most 7.3 roots of the second one."""
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
        shape = self.weights.shape
        weights, averaged = (
            checked_array(arrays, name, shape, most=self.MOST) for name in ("weights", "averaged")
        )
        mean = checked_array(arrays, "first_moments", shape)
        square = checked_array(arrays, "second_moments", shape, least=0)
        if (np.abs(mean) > self.MOST_ROOTS * (np.sqrt(square) + self.LEAST_ROOT)).any():
            raise ValueError(
                f"the saved first_moments are above {self.MOST_ROOTS:g} roots of second_moments; must be less"
            )
        self._steps = int(checked_array(arrays, "updates", (), least=0, whole=True))
        self.weights, self.averaged, self._mean, self._square = (
            each.astype(np.float32) for each in (weights, averaged, mean, square)
        )


def _silu(sums: Float32) -> tuple[Float32, Float32]:
    """SiLU of sums (n, k), x σ(x), and its slope."""
    share = 0.5 + 0.5 * np.tanh(0.5 * sums)
    values = sums * share
    return values, share + values * (1 - share)


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

    def judge(self, pairs: ReplayPairs) -> tuple[Array, Array, Array]:
        """What the network says of pairs of observations.

        Returns:
            Words made (n, m) and words said for the changes seen (n, m), relative to `register_scale`, and
            lengths (n,) of these changes.
        """
        said = self.words(pairs.sensors, pairs.registers, pairs.change) / self.register_scale
        return pairs.words / self.register_scale, said, np.sqrt(self._size(pairs.change))

    def train(self, pairs: ReplayPairs, steps: int, usual_error: float) -> None:
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
        center = checked_array(arrays, "center", (SENSORS,), most=FARTHEST)
        image_scale = float(checked_array(arrays, "image_scale", (), least=0))
        register_scale = checked_array(arrays, "register_scale", (self.motors,))
        if not register_scale.all():
            raise ValueError("the saved register_scale hold 0; allowed: others, of which words are multiples")
        self._network.restore(arrays)
        self._center, self.image_scale, self.register_scale = center, image_scale, register_scale
