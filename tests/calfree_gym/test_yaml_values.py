"""YAML 1.1 takes some numbers otherwise than whoever writes them."""

import re

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from calfree_gym.errors.yaml_values import UnclearNumberError, read
from calfree_gym.vision import Marks

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


MERGED = "".join(f"k{i}: &k{i} {{<<: [*k{i - 1}, *k{i - 1}]}}\n" for i in range(1, 40))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("&a [*a]", "found inf values, aliases written out; allowed: 1000000"),
        ("k0: &k0 {a: 1}\n" + MERGED, r"found \d{7} values, aliases written out"),
        ("k0: &k0 {a: 1}\n" + MERGED + "? [*k39]\n: 1", r"found \d{7} values"),
        ("[" * 3000, "nested too deeply"),
    ],
    ids=["cycle", "merges", "key", "deep"],
)
def test_what_would_fill_memory_or_take_for_ever_is_refused(text, said):
    with pytest.raises((ValueError, yaml.YAMLError), match=said):
        read(text)


def test_files_of_marks_are_read_so(tmp_path):
    (tmp_path / "marks.yaml").write_text("object: {rgb: [010, 200, 20]}")
    with pytest.raises(ValueError, match=r"marks\.yaml: object\.rgb\.0: found 010, which YAML takes for 8"):
        Marks.load(tmp_path / "marks.yaml")
