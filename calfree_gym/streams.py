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
