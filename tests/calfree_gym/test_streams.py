"""Named streams are NumPy's own, of a seed and a spawn key."""

import zlib

import numpy as np
import pytest

from calfree_gym.streams import stream

NAME = "world_lens"


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**32, 2**63])
@pytest.mark.parametrize("indices", [(), (0,), (3, 2**32 - 1), (2**32, 0)])
def test_a_stream_is_that_of_its_seed_and_spawn_key(seed, indices):
    sequence = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(NAME.encode()), *indices))
    np.testing.assert_array_equal(
        stream(seed, NAME, *indices).random(9), np.random.Generator(np.random.PCG64(sequence)).random(9)
    )
