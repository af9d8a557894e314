"""Marks as values: colours, dicts, files and errors."""

import sys

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from calfree_gym.vision.marks import MARK_NAMES, Mark, Marks, hue_gap
from calfree_gym.vision.tracking.blobs import ColourTable, hues_and_saturations

RED, YELLOW, CYAN = Mark((230, 20, 30)), Mark((220, 210, 10)), Mark((10, 200, 210))
channel = st.integers(0, 255)


@given(st.tuples(channel, channel, channel))
def test_hue_and_saturation_are_those_of_pixels(rgb):
    assume(max(rgb) > 0 and (max(rgb) - min(rgb)) / max(rgb) >= 0.5)
    hue, saturation = hues_and_saturations(np.array(rgb))
    mark = Mark(rgb)
    assert hue_gap(mark.hue, float(hue)) < 1e-9
    assert mark.saturation == saturation
    assert Mark.from_dict(mark.to_dict()) == mark


@pytest.mark.parametrize(("rgb", "hue"), [((200, 0, 0), 0), ((0, 90, 0), 120), ((0, 0, 255), 240)])
def test_pure_colours_have_their_usual_hues(rgb, hue):
    assert Mark(rgb).hue == hue
    assert Mark(rgb).saturation == 1


def test_dicts_and_files_give_the_same_marks_back(tmp_path):
    marks = Marks(gripper_1=RED, object=Mark((10, 200, 210), 33.5))
    assert Marks.from_dict(marks.to_dict()) == marks
    marks.save(tmp_path / "marks.yaml")
    assert Marks.load(tmp_path / "marks.yaml") == marks
    assert "rgb: [230, 20, 30]" in (tmp_path / "marks.yaml").read_text()


def test_a_missing_mark_is_its_default_or_one_that_is_like_no_other():
    default = Marks()
    assert Marks.from_dict({}) == default
    swapped = Marks.from_dict({"gripper_1": {"rgb": [13, 242, 13]}})
    assert swapped.gripper_2 == default.gripper_2
    assert swapped.object == default.gripper_1


@given(st.lists(st.floats(0, 359), min_size=1, max_size=2), st.permutations(MARK_NAMES))
def test_any_marks_that_are_unlike_each_other_can_be_completed(hues, names):
    marks = {}
    for hue, name in zip(hues, names, strict=False):
        apart = [abs((hue - top + 180) % 360 - 180) for top in (0, 120, 240)]
        marks[name] = {"rgb": [round(255 * np.clip(2 - each / 60, 0, 1)) for each in apart]}
    found = [Mark.from_dict(mark).hue for mark in marks.values()]
    assume(len(found) < 2 or hue_gap(*found) >= 40)
    completed = Marks.from_dict(marks)
    assert all(getattr(completed, name).rgb == tuple(mark["rgb"]) for name, mark in marks.items())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rgb": [120, 100, 110]}, r"\(120, 100, 110\) has saturation 0.17, too grey .* 0.5 or more"),
        ({"rgb": [0, 0, 0]}, "saturation 0.00"),
        ({"rgb": [0, 0]}, r"\[0, 0\]; it must be three whole numbers from 0 to 255"),
        ({"rgb": [0, 0, 256]}, "0 to 255"),
        ({"rgb": [0, 0.5, 200]}, "whole numbers"),
        ({"rgb": "red"}, "'red'; it must be three"),
        ({"rgb": [0, 0, 200], "hue_tolerance": 0}, r"hue_tolerance is 0; it must be in \(0, 60\]"),
        ({"rgb": [0, 0, 200], "hue_tolerance": float("nan")}, "hue_tolerance is nan"),
        ({"rgb": [0, 0, 200], "hue_tolerance": True}, "hue_tolerance is True"),
        ({}, "a mark lacks rgb"),
        ({"rbg": [0, 0, 200]}, r"unknown 'rbg' \(did you mean rgb\?\); allowed: rgb, hue_tolerance"),
        ([0, 0, 200], r"a mark must be a mapping with rgb, hue_tolerance; found \[0, 0, 200\]"),
    ],
)
def test_what_is_no_mark_raises_and_says_which(values, message):
    with pytest.raises(ValueError, match=message):
        Mark.from_dict(values)
    with pytest.raises(ValueError, match=r"object: .*" + message):
        Marks.from_dict({"object": values})


def test_marks_that_are_none_or_too_like_each_other_are_named():
    with pytest.raises(ValueError, match=r"marks gripper_1 and object are too like each other: .* 9 degrees"):
        Marks(gripper_1=RED, object=Mark((230, 50, 30)))
    with pytest.raises(ValueError, match=r"unknown 'gripper1' \(did you mean gripper_1"):
        Marks.from_dict({"gripper1": RED.to_dict()})
    with pytest.raises(ValueError, match=r"Marks.object is 'green'; it must be a Mark"):
        Marks(object="green")


@pytest.mark.parametrize("text", ["", "[1, 2]", "object: {rgb: [1, 2]}", "object: ]"])
def test_files_that_hold_no_marks_raise_and_are_named(tmp_path, text):
    (tmp_path / "marks.yaml").write_text(text)
    with pytest.raises(ValueError, match=r"marks\.yaml"):
        Marks.load(tmp_path / "marks.yaml")
    with pytest.raises(FileNotFoundError, match=r"none.yaml"):
        Marks.load(tmp_path / "none.yaml")


@pytest.mark.parametrize("use", [Marks.load, Marks().save])
def test_without_pyyaml_the_error_names_it(tmp_path, monkeypatch, use):
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(ImportError, match=r"PyYAML: pip install pyyaml, or pip install '\.\[vision\]' in"):
        use(tmp_path / "marks.yaml")


OF_MARKS = [(242, 13, 140), (13, 13, 242), (10, 200, 210)]
OF_NONE = [(120, 120, 120), (230, 20, 30), (220, 210, 10)]
DULL = [(120, 180, 120), (180, 130, 160), (14, 14, 20), (2, 20, 2), (0, 0, 0), (255, 255, 255)]


@pytest.mark.parametrize(
    ("marks", "colours", "expected"),
    [(Marks(object=CYAN), OF_MARKS + OF_NONE, [1, 2, 3, 0, 0, 0]), (Marks(), DULL, [0] * 6)],
    ids=["hues", "dull and dark"],
)
def test_pixels_belong_to_the_mark_of_their_hue_at_any_brightness(marks, colours, expected):
    table = ColourTable(marks)
    for brightness in (0.3, 0.6, 1.0):
        image = np.round(np.array(colours) * brightness).astype(np.uint8)[None]
        assert table.marks_of(image).tolist() == table.look_up(image).tolist() == [expected]
