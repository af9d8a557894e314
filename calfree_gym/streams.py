"""Named streams of random numbers: drawing more from one changes no number of another."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Key = tuple[int, int]
"""Names the counter-based streams of one purpose under one seed."""


def _sequence(seed: int, name: str, *indices: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), *indices))


def stream(seed: int, name: str, *indices: int) -> np.random.Generator:
    """Returns the generator that belongs to `name` and `indices` under `seed`.

    Args:
        seed: Non-negative integer, the seed of a world and all its trials.
        name: What the numbers are for, such as "world_lens".
        *indices: Which of them, such as the attempt.
    """
    return np.random.Generator(np.random.PCG64(_sequence(seed, name, *indices)))


def key(seed: int, name: str) -> Key:
    """The key of the counter-based streams that belong to `name` under `seed`."""
    first, second = _sequence(seed, name).generate_state(2, np.uint64).tolist()
    return first, second


class MotionNumbers:
    """Random numbers for every motion of N rows: pure functions of seed, trial and motion of the trial.

    They come from `CounterStreams`, in blocks of motions.

    Args:
        rows: N.
        name: What they are for.
        shape: Of the numbers for one motion.
        normal: Whether they are standard normal, else uniform in [0, 1).
    """

    BLOCK = 16

    def __init__(self, rows: int, name: str, shape: tuple[int, ...], normal: bool) -> None:
        self._name = name
        self._normal = normal
        self._keys: list[Key] = [(0, 0)] * rows
        self._streams = CounterStreams()
        self._numbers = np.zeros((rows, self.BLOCK, *shape))
        self._loaded = np.full(rows, -1)
        self._by_motion = self._numbers.reshape(rows * self.BLOCK, *shape)
        self._first = self.BLOCK * np.arange(rows)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._keys[row] = key(seed, self._name)
        self._loaded[row] = -1

    def at(self, trials: NDArray[np.int64], motions: NDArray[np.int64]) -> NDArray[np.float64]:
        """The numbers (N, *shape) of the rows' present trial and motion of the trial (N,)."""
        blocks, places = motions // self.BLOCK, motions % self.BLOCK
        wanted = trials * 2**32 + blocks
        if len(stale := (wanted != self._loaded).nonzero()[0]):
            self._load(stale, trials, blocks)
            self._loaded = wanted
        return self._by_motion.take(self._first + places, axis=0)

    def _load(self, rows: NDArray[np.intp], trials: NDArray[np.int64], blocks: NDArray[np.int64]) -> None:
        generator = self._streams.generator
        draw = generator.standard_normal if self._normal else generator.random
        for row, trial, block in zip(
            rows.tolist(), trials[rows].tolist(), blocks[rows].tolist(), strict=True
        ):
            self._streams.go_to(self._keys[row], trial, block)
            draw(out=self._numbers[row])


class CounterStreams:
    """Philox streams, found by key and counter in a microsecond: for numbers needed at every motion.

    Attributes:
        generator: Draws from the stream to which `go_to` went last.
    """

    def __init__(self) -> None:
        self._bits = np.random.Philox(key=[0, 0])
        self._state: Any = self._bits.state
        self._state["buffer"] = self._state["buffer"].tolist()  # lists are read faster than arrays
        self.generator = np.random.Generator(self._bits)

    def go_to(self, stream_key: Key, first: int, second: int) -> None:
        """Goes to the beginning of the stream of one key and two indices."""
        self._state["state"] = {"key": stream_key, "counter": (0, 0, first, second)}
        self._bits.state = self._state
