"""Image units and streams: what rounding and seeds must not decide."""

import zlib

import numpy as np
import pytest

from calfree_gym.image import IMAGE_UNIT, inner, inside, lengths, lengths_px, rounded
from calfree_gym.streams import stream


def test_lengths_in_units_and_in_pixels():
    vectors = IMAGE_UNIT * np.array([[[3.0, 4.0], [0.0, -2.0]], [[0.0, 0.0], [8.0, 6.0]]])
    np.testing.assert_allclose(lengths_px(vectors), [[5, 2], [0, 10]])
    np.testing.assert_allclose(lengths(vectors), IMAGE_UNIT * np.array([[5, 2], [0, 10]]))
    assert lengths_px(vectors.astype(np.float32)).dtype == np.float32


def test_what_is_inside_lies_within_both_borders_and_their_margin():
    points = np.array([[1.0, -1.0], [0.0, 1.001], [-1.001, 0.0], [1 - 16 * IMAGE_UNIT, 0.0]])
    assert inside(points).tolist() == [True, False, False, True]
    assert inside(points, 16).tolist() == [False, False, False, True]
    assert inside(points, 17).tolist() == [False] * 4


@pytest.mark.parametrize("size", [1.0, -1.0, 3e-30, 7e40])
def test_the_first_of_equals_is_the_least_and_the_largest(size):
    values = size * (1 + np.array([0.0, 3e-16, -3e-16, 1e-12]))
    assert rounded(values).argmin() == rounded(values).argmax() == 0
    np.testing.assert_array_equal(rounded(values).argsort(kind="stable"), range(4))


def test_what_differs_is_not_equal():
    values = np.array([2.0, 2.0 + 1e-5, -2.0, 0.0, np.inf, -np.inf])
    np.testing.assert_array_equal(rounded(values).argsort(kind="stable"), values.argsort(kind="stable"))
    np.testing.assert_allclose(rounded(values), values, rtol=1e-6)
    assert rounded(0.3) < rounded(0.30001)


@pytest.mark.parametrize("seed", range(10))
def test_an_inner_product_of_perpendicular_vectors_has_no_sign(seed):
    one, other = np.linalg.qr(np.random.default_rng(seed).normal(size=(6, 2)))[0].T
    small, large = 1e-3 * one, 40 * other
    assert inner(small, large) == 0
    assert inner(small, np.zeros(6)) == 0
    assert inner(small, large - 1e-2 * one) == pytest.approx(-1e-5, rel=1e-3)


NAME = "world_lens"


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**32, 2**63])
@pytest.mark.parametrize("indices", [(), (0,), (3, 2**32 - 1), (2**32, 0)])
def test_a_stream_is_that_of_its_seed_and_spawn_key(seed, indices):
    sequence = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(NAME.encode()), *indices))
    np.testing.assert_array_equal(
        stream(seed, NAME, *indices).random(9), np.random.Generator(np.random.PCG64(sequence)).random(9)
    )
