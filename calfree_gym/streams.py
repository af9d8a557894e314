"""Named streams of random numbers: who draws more from one moves no number of another."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

Key = NDArray[np.uint64]


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
    """The key (2,) of the counter-based streams that belong to `name` under `seed`."""
    return _sequence(seed, name).generate_state(2, np.uint64).astype(np.uint64)


class LookNumbers:
    """Random numbers for every look of N rows: pure functions of seed, trial and motion.

    They come from Philox streams, found by key and counter in a microsecond, in blocks of motions.

    Args:
        rows: N.
        name: What they are for.
        shape: Of the numbers for one look.
        normal: Whether they are standard normal, else uniform in [0, 1).
    """

    BLOCK = 16

    def __init__(self, rows: int, name: str, shape: tuple[int, ...], normal: bool) -> None:
        self._name = name
        self._normal = normal
        self._keys = np.zeros((rows, 2), np.uint64)
        self._streams = CounterStreams()
        self._numbers = np.zeros((rows, self.BLOCK, *shape))
        self._loaded = np.full(rows, -1)
        self._all = np.arange(rows)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._keys[row] = key(seed, self._name)
        self._loaded[row] = -1

    def at(self, trials: NDArray[np.int64], motions: NDArray[np.int64]) -> NDArray[np.float64]:
        """The numbers (N, *shape) of the rows' present trial and motion of the trial (N,)."""
        wanted = trials * 2**32 + motions // self.BLOCK
        for row in (wanted != self._loaded).nonzero()[0]:
            keyed = self._streams.at(self._keys[row], trials[row], motions[row] // self.BLOCK)
            draw = keyed.standard_normal if self._normal else keyed.random
            draw(out=self._numbers[row])
        self._loaded = wanted
        return self._numbers[self._all, motions % self.BLOCK]


class CounterStreams:
    """Philox streams, found by key and counter in a microsecond: for numbers needed at every motion."""

    def __init__(self) -> None:
        self._bits = np.random.Philox(key=[0, 0])
        self._state = self._bits.state
        self._generator = np.random.Generator(self._bits)

    def at(self, stream_key: Key, first: int, second: int) -> np.random.Generator:
        """The generator of one key and two indices, to be used before the next call."""
        self._state["state"]["key"] = stream_key
        self._state["state"]["counter"][2] = first
        self._state["state"]["counter"][3] = second
        self._bits.state = self._state
        return self._generator
