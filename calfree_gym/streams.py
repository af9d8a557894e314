"""Named streams of random numbers: drawing more from one changes no number of another."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Key = tuple[int, int]
"""Names the counter-based streams of one purpose under one seed."""
_WORD = 2**32


def _sequence(seed: int, name: str, *indices: int) -> np.random.SeedSequence:
    """The sequence of `seed` and the spawn key (name, *indices).

    Where each is one word, these are given as NumPy puts them together, which takes a third of the time.
    """
    spawn_key = zlib.crc32(name.encode()), *indices
    if max(seed, *spawn_key) < _WORD:
        return np.random.SeedSequence(np.array([seed, 0, 0, 0, *spawn_key], np.uint32))
    return np.random.SeedSequence(seed, spawn_key=spawn_key)


def stream(seed: int, name: str, *indices: int) -> np.random.Generator:
    """Returns the generator that belongs to `name` and `indices` under `seed`.

    Args:
        seed: Non-negative integer, the seed of a world and all its trials.
        name: What the numbers are for, such as "world_lens".
        *indices: Which of them, such as the attempt.
    """
    return np.random.Generator(np.random.PCG64(_sequence(seed, name, *indices)))


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
        self._normal = normal
        self._streams = CounterStreams(rows, name)
        self._numbers = np.zeros((rows, self.BLOCK, *shape))
        self._loaded = np.full(rows, -1)
        self._by_motion = self._numbers.reshape(rows * self.BLOCK, *shape)
        self._first = self.BLOCK * np.arange(rows)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._streams.seed(row, seed)
        self._loaded[row] = -1

    def at(self, trials: NDArray[np.int64], motions: NDArray[np.int64]) -> NDArray[np.float64]:
        """The numbers (N, *shape) of the rows' present trial and motion of the trial (N,)."""
        blocks, places = np.divmod(motions, self.BLOCK)
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
            self._streams.go_to(row, trial, block)
            draw(out=self._numbers[row])


class CounterStreams:
    """Philox streams of N rows, found by counters in a microsecond: for numbers needed at every motion.

    Attributes:
        generator: Draws from the stream to which `go_to` went last.

    Args:
        rows: N.
        name: What they are for.
    """

    def __init__(self, rows: int, name: str) -> None:
        self._name = name
        self._seeds = [0] * rows
        self._keys: list[Key | None] = [(0, 0)] * rows
        self._bits = np.random.Philox(key=[0, 0])
        self._state: Any = self._bits.state
        self._state["buffer"] = self._state["buffer"].tolist()  # lists are read faster than arrays
        self.generator = np.random.Generator(self._bits)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`; its key is made when it is first needed."""
        self._seeds[row], self._keys[row] = seed, None

    def go_to(self, row: int, first: int, second: int) -> None:
        """Goes to the beginning of the row's stream of two indices."""
        if (key := self._keys[row]) is None:
            words = _sequence(self._seeds[row], self._name).generate_state(2, np.uint64).tolist()
            key = self._keys[row] = words[0], words[1]
        self._state["state"] = {"key": key, "counter": (0, 0, first, second)}
        self._bits.state = self._state
