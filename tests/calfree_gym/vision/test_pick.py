"""`python -m calfree_gym.vision pick`: a mark's colour from one's own picture."""

import re

import cv2
import numpy as np
import pytest

from calfree_gym.vision.__main__ import main
from calfree_gym.vision.marks import Mark, Marks, hue_gap
from calfree_gym.vision.pick import learn_mark
from calfree_gym.vision.tracking.tracker import StereoTracker
from tests.calfree_gym.vision.drawings import Canvas, background, camera

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
    """The picture with a part in one colour."""
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


def test_a_mark_picked_again_replaces_itself_and_no_other(picture):
    assert pick(picture, "object") == 0
    assert pick(picture, "gripper_1") == 0
    before = Marks.load(picture.parent / "marks.yaml")
    assert pick(picture, "object", where=" ".join(box("gripper_2"))) == 0
    after = Marks.load(picture.parent / "marks.yaml")
    assert after.gripper_1 == before.gripper_1
    assert hue_gap(after.object.hue, Mark(COLOURS["gripper_2"]).hue) < 10


@pytest.mark.parametrize("half", [9, 14, 22, 30])
def test_the_box_may_hold_background(picture, half):
    image = np.ascontiguousarray(cv2.imread(str(picture))[..., ::-1])
    for name in COLOURS:
        mark = learn_mark(image, [int(v) for v in box(name, half)])
        assert hue_gap(mark.hue, Mark(COLOURS[name]).hue) < 10
        assert mark.saturation > 0.7


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


def test_a_colour_like_another_marks_is_refused_and_the_file_stays(picture, capsys):
    assert pick(picture, "object") == 0
    before = (picture.parent / "marks.yaml").read_text()
    assert pick(picture, "gripper_1", where=" ".join(box("object"))) == 2
    assert "marks gripper_1 and object are too like each other" in capsys.readouterr().err
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
