"""Marks as values, dicts and files, and as learned from one's own picture."""

import os
import re
import sys

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from calfree_gym.vision.__main__ import main
from calfree_gym.vision.marks import MARK_NAMES, Mark, Marks, hue_gap
from calfree_gym.vision.pick import learn_mark
from calfree_gym.vision.tracking.blobs import ColourTable, hues_and_saturations
from calfree_gym.vision.tracking.tracker import StereoTracker
from tests.calfree_gym.vision.drawings import Canvas, background, camera

RED, CYAN = Mark((230, 20, 30)), Mark((10, 200, 210))
channel = st.integers(0, 255)


@given(st.tuples(channel, channel, channel))
def test_hue_and_saturation_are_those_of_pixels(rgb):
    assume(max(rgb) > 0 and (max(rgb) - min(rgb)) / max(rgb) >= 0.5)
    hue, saturation = hues_and_saturations(np.array(rgb))
    mark = Mark(rgb)
    assert hue_gap(mark.hue, float(hue)) < 1e-9
    assert mark.saturation == saturation
    assert Mark.from_dict(mark.to_dict()) == mark


def test_dicts_and_files_give_the_same_marks_back(tmp_path):
    marks = Marks(gripper_1=RED, object=Mark((10, 200, 210), 33.5))
    assert Marks.from_dict(marks.to_dict()) == marks
    marks.save(tmp_path / "marks.yaml")
    assert Marks.load(tmp_path / "marks.yaml") == marks
    assert "rgb: [230, 20, 30]" in (tmp_path / "marks.yaml").read_text()


def full_disk(file):
    raise OSError("no space left")


def test_a_file_stays_as_it_is_where_it_cannot_be_written_and_is_written_where_a_link_leads(
    tmp_path, monkeypatch
):
    file, link = tmp_path / "marks.yaml", tmp_path / "link"
    link.symlink_to(file)
    Marks(object=CYAN).save(link)
    assert link.is_symlink()
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="no space left"):
        Marks().save(file)
    assert Marks.load(file).object == CYAN


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


COLOURS = {"gripper_1": (150, 20, 230), "gripper_2": (20, 190, 200), "object": (225, 215, 20)}
PLACES = {"gripper_1": (60.0, 70.0), "gripper_2": (190.0, 60.0), "object": (130.0, 190.0)}


@pytest.fixture
def picture(tmp_path):
    """A picture (256, 256) of a violet, a cyan and a yellow ball, 12 px in radius."""
    rng = np.random.default_rng(3)
    canvas = Canvas(background(rng, 256, 256))
    for name, place in PLACES.items():
        canvas.ball(name, place, 12, COLOURS[name], rng)
    image = camera(canvas.picture, rng, white_balance=0.05, jpeg=0)
    cv2.imwrite(str(tmp_path / "room.png"), image[..., ::-1])
    return tmp_path / "room.png"


def box(name, half=18):
    x, y = PLACES[name]
    return [str(int(v)) for v in (x - half, y - half, 2 * half, 2 * half)]


def pick(picture, name, *extra, where=None):
    out = ["--out", str(picture.parent / "marks.yaml")]
    place = where.split() if where else box(name)
    return main(["pick", str(picture), "--box", *place, "--mark", name, *out, *extra])


def painted(picture, part, rgb):
    image = cv2.imread(str(picture))
    image[part] = rgb[::-1]
    cv2.imwrite(str(picture), image)


def test_marks_picked_one_after_the_other_are_found_in_the_picture(picture, capsys):
    for name, place in PLACES.items():
        assert pick(picture, name) == 0
        text = capsys.readouterr().out
        assert f"learned {name}: rgb (" in text
        assert f"the tracker finds {name} in the box, at ({place[0]:.0f}"[:-2] in text
    marks = Marks.load(picture.parent / "marks.yaml")
    for name, colour in COLOURS.items():
        assert hue_gap(getattr(marks, name).hue, Mark(colour).hue) < 10
    image = np.ascontiguousarray(cv2.imread(str(picture))[..., ::-1])
    points, visible = StereoTracker(marks)(image, image)
    assert visible.all()
    np.testing.assert_allclose(points[2] * 128 + 128, PLACES["object"], atol=1)
    np.testing.assert_allclose(points[0] * 128 + 128, (125, 65), atol=3)


@pytest.mark.parametrize("half", [9, 14, 22, 30])
def test_the_box_may_hold_background(picture, half):
    image = np.ascontiguousarray(cv2.imread(str(picture))[..., ::-1])
    for name in COLOURS:
        mark = learn_mark(image, [int(v) for v in box(name, half)])
        assert hue_gap(mark.hue, Mark(COLOURS[name]).hue) < 10
        assert mark.saturation > 0.7


def test_a_box_of_a_dark_colour_with_a_vivid_spot_gives_the_spot_s():
    image = np.full((40, 40, 3), (5, 0, 23), np.uint8)
    image[18:24, 18:24] = 20, 160, 20
    assert hue_gap(learn_mark(image, [10, 10, 20, 20]).hue, 120) < 10


NOT_FOUND = "the tracker does not find object.*a radius of 0.5% to 9% of the image's shorter side"
SOMETHING_ELSE = r"takes something else for object, outside the box, at \(130"


@pytest.mark.parametrize(
    ("part", "rgb", "where", "told"),
    [
        (np.s_[150:250, 10:120], (210, 20, 30), "20 160 50 50", NOT_FOUND),
        (np.s_[5:25, 100:250], COLOURS["object"], "110 6 16 16", SOMETHING_ELSE),
    ],
)
def test_what_is_learned_but_not_found_is_told(picture, capsys, part, rgb, where, told):
    painted(picture, part, rgb)
    assert pick(picture, "object", where=where) == 1
    assert re.search(told, capsys.readouterr().out, re.DOTALL)


@pytest.mark.parametrize(
    ("rgb", "where", "message"),
    [
        (None, "250 10 20 20", "the box from (250, 10) to (270, 30) is not within the image of 256 × 256 px"),
        (None, "-1 10 20 20", "not within the image"),
        (None, "10 240 20 20", "not within the image"),
        (None, "10 10 0 20", "the box is 0 × 20 px; it must be 3 × 3 or more"),
        (None, "10 10 20 -4", "the box is 20 × -4 px"),
        ((110, 112, 118), "5 5 40 40", "too grey or too dark"),
        ((10, 12, 3), "5 5 40 40", "too grey or too dark"),
        (
            (130, 100, 90),
            "5 5 40 40",
            "saturation 0.31, too grey to be told from a background; it must be 0.5",
        ),
    ],
)
def test_boxes_and_colours_that_cannot_be_are_refused(picture, capsys, rgb, where, message):
    if rgb:
        painted(picture, np.s_[:60, :60], rgb)
    assert pick(picture, "object", where=where) == 2
    assert message in capsys.readouterr().err
    assert not (picture.parent / "marks.yaml").exists()


def test_what_cannot_be_learned_or_written_leaves_the_file_as_it_is(picture, capsys, monkeypatch):
    assert pick(picture, "object") == 0
    before = (picture.parent / "marks.yaml").read_text()
    assert pick(picture, "gripper_1", where=" ".join(box("object"))) == 2
    assert "marks gripper_1 and object are too like each other" in capsys.readouterr().err
    assert (picture.parent / "marks.yaml").read_text() == before
    monkeypatch.setattr(os, "fsync", full_disk)
    assert pick(picture, "gripper_1") == 2
    assert "no space left" in capsys.readouterr().err
    assert (picture.parent / "marks.yaml").read_text() == before


def test_files_that_cannot_be_used_are_refused(picture, capsys):
    missing = picture.parent / "none.png"
    assert pick(missing, "object") == 2
    assert "none.png" in capsys.readouterr().err
    for content in (b"", b"no image"):
        missing.write_bytes(content)
        assert pick(missing, "object") == 2
        assert "none.png is no image; allowed: what OpenCV reads" in capsys.readouterr().err
    (picture.parent / "marks.yaml").write_text("objects: 3")
    assert pick(picture, "object") == 2
    assert "marks.yaml: unknown 'objects' (did you mean object?)" in capsys.readouterr().err
    assert (picture.parent / "marks.yaml").read_text() == "objects: 3"
