"""Image units, streams and YAML: what rounding, seeds and notations must not decide."""

import re
import zlib

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from calfree_gym.errors.yaml_values import UnclearNumberError, read
from calfree_gym.image import IMAGE_UNIT, inner, inside, lengths, lengths_px, rounded
from calfree_gym.streams import stream
from calfree_gym.vision import Marks


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


PLAIN = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text("abé: #'-_~", max_size=5)
)


@given(
    st.recursive(PLAIN, lambda inner: st.lists(inner) | st.dictionaries(st.text("abc"), inner), max_leaves=8)
)
def test_what_pyyaml_writes_is_read(values):
    assert read(yaml.safe_dump(values)) == values


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1_000_000", 10**6),
        ("-1_500.25", -1500.25),
        (".5", 0.5),
        ("2.0e+1", 20.0),
        ("'010'", "010"),
        ("0", 0),
    ],
)
def test_what_is_clear_is_read(text, value):
    assert read(text) == value


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("010", "found 010, which YAML takes for 8; allowed: decimal numbers"),
        ("1:30", "found 1:30, which YAML takes for 90; allowed: decimal numbers"),
        ("1:30.5", "found 1:30.5, which YAML takes for 90.5"),
        ("0b1", "found 0b1, which YAML takes for 1"),
        ("0x1F", "found 0x1F, which YAML takes for 31"),
        ("1_0", "found 1_0, which YAML takes for 10"),
        ("0o10", "found '0o10', which YAML takes for text; allowed"),
        ("08", "found '08', which YAML takes for text; allowed"),
        ("2e1", "found '2e1', which YAML takes for text; write 20 or 2.0e+1; allowed"),
        ("2.5E1", "found '2.5E1', which YAML takes for text; write 25 or 2.5e+1; allowed"),
        ("1e-9", "found '1e-9', which YAML takes for text; write 1.0e-9; allowed"),
    ],
)
def test_what_is_unclear_is_refused_wherever_it_stands(text, said):
    for within, where in (
        ("{}", ""),
        ("a: {{b: [1, {}]}}", "a.b.1: "),
        ("- 1\n- a: {}", "1.a: "),
        ("? {}\n: 1", f"{text}: "),
        ("a: &it {{b: 1}}\nc: {{<<: *it, d: {}}}", "c.d: "),
    ):
        with pytest.raises(UnclearNumberError, match="^" + re.escape(where + said.split(";")[0])) as error:
            read(within.format(text))
        assert said in str(error.value)


def test_a_list_within_itself_is_read():
    (inner,) = read("&a [*a]")
    assert inner is inner[0]


def test_files_of_marks_are_read_so(tmp_path):
    (tmp_path / "marks.yaml").write_text("object: {rgb: [010, 200, 20]}")
    with pytest.raises(ValueError, match=r"marks\.yaml: object\.rgb\.0: found 010, which YAML takes for 8"):
        Marks.load(tmp_path / "marks.yaml")
