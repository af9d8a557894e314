"""Printed tags, on drawn frames and on the page that is printed, against geometry of our own."""

import os
import re
from pathlib import Path

import cv2
import matplotlib.cbook
import numpy as np
import PIL.Image
import pytest

from calfree_gym.vision import TagTracker
from calfree_gym.vision.tags import print_tags
from tests.calfree_gym.vision.drawings import background, cut_out
from tests.calfree_gym.vision.printed_tags import (
    CELL,
    HEIGHT,
    WIDTH,
    arch,
    camera,
    card,
    put,
    random_frame,
    random_pose,
)

DEBIAN = Path("/usr/share/doc/opencv-doc/examples")
"""Of Debian's package opencv-doc."""
PHOTOGRAPHS = (
    *("aero1.jpg", "aero3.jpg", "aloeL.jpg", "aloeR.jpg", "apple.jpg", "baboon.jpg", "basketball1.png"),
    *("basketball2.png", "blox.jpg", "board.jpg", "box.png", "box_in_scene.png", "building.jpg"),
    *("butterfly.jpg", "chicky_512.png", "ela_modified.jpg", "ela_original.jpg", "fruits.jpg", "graf1.png"),
    *("graf3.png", "home.jpg", "left.jpg", "left01.jpg", "left05.jpg", "left13.jpg", "leuvenA.jpg"),
    *("leuvenB.jpg", "licenseplate_motion.jpg", "messi5.jpg", "orange.jpg", "right.jpg", "right08.jpg"),
    *("rubberwhale1.png", "rubberwhale2.png", "smarties.png", "squirrel_cls.jpg", "stuff.jpg"),
    *("sudoku.png", "text_defocus.jpg", "text_motion.jpg"),
)
"""Of its folder data. They show no tag."""


def pixels(points):
    """Image points (4, 2) of a tracker, in px from the corner of an image."""
    return points * (max(WIDTH, HEIGHT) / 2) + [WIDTH / 2, HEIGHT / 2]


def errors(frames):
    """Of gripper and object (n, 2), in px; nan where they are not seen. Both cameras see each frame."""
    found = []
    for image, places in frames:
        points, visible = TagTracker()(image, image)
        np.testing.assert_array_equal(points[::2], points[1::2])
        off = np.hypot(*(pixels(points[::2]) - places).T)
        found.append(np.where(visible[::2], off, np.nan))
    return np.array(found)


def assert_found(error):
    assert (np.isfinite(error).mean(0) >= 0.98).all()
    assert (np.nanmedian(error, 0) <= 0.5).all()
    assert (np.nanquantile(error, 0.95, 0) <= 1).all()


def test_tags_that_are_tilted_by_up_to_45_degrees_are_found_within_half_a_pixel():
    with matplotlib.cbook.get_sample_data("grace_hopper.jpg") as file:
        photograph = np.array(PIL.Image.open(file).convert("RGB"))
    behind = background, cut_out(photograph)
    assert_found(errors(random_frame(np.random.default_rng([0, i]), behind[i % 2]) for i in range(50)))


def scene(*prints, seed=0, tilt=0.5):
    """An image (h, w, 3) of prints, each seen at a place in px."""
    rng = np.random.default_rng(seed)
    picture = np.full((HEIGHT, WIDTH, 3), 110, np.float32)
    for print_, place in prints:
        put(picture, *print_, random_pose(rng, place, tilt), rng)
    return camera(picture, rng)


LEFT, RIGHT, BELOW = (150, 180), (460, 180), (320, 370)


@pytest.mark.parametrize(
    ("prints", "gripper", "object_"),
    [
        ([(arch(), LEFT), (card(), RIGHT)], True, True),
        ([(arch((0, None)), LEFT), (card(), RIGHT)], False, True),
        ([(arch((None, 1)), LEFT), (card(), RIGHT)], False, True),
        ([(arch((0, None)), LEFT), (arch((None, 1)), RIGHT), (card(), BELOW)], False, True),
        ([(arch((1, 0)), LEFT), (card(), RIGHT)], False, True),
        ([(arch(), LEFT), (arch((0, None)), RIGHT), (card(), BELOW)], False, True),
        ([(card(), LEFT), (card(), RIGHT), (arch(), BELOW)], True, False),
        ([], False, False),
    ],
    ids=["both", "only 0", "only 1", "on two prints", "exchanged", "one twice", "the object twice", "none"],
)
def test_the_gripper_is_seen_where_both_tags_of_one_flat_print_are(prints, gripper, object_):
    tracker, here = TagTracker(), scene((arch(), LEFT), (card(), RIGHT))
    before, visible = tracker(here, here)
    assert visible.all()
    points, visible = tracker(here, scene(*prints))
    assert visible.tolist() == [True, gripper, True, object_]
    np.testing.assert_array_equal(points[~visible], before[~visible])


def numbers(pattern, text):
    """What the groups of all matches say (n, groups)."""
    return np.array([np.atleast_1d(each).astype(float) for each in re.findall(pattern, text, re.MULTILINE)])


@pytest.mark.parametrize(("paper", "size"), [("A4", (210, 297)), ("Letter", (215.9, 279.4))])
def test_the_page_shows_the_prints_in_true_size(paper, size, tmp_path):
    print_tags(tmp_path / "tags.pdf", paper)
    text = (tmp_path / "tags.pdf").read_text("ascii")
    mm = 72 / 25.4
    np.testing.assert_allclose(numbers(r"MediaBox \[0 0 (\S+) (\S+)\]", text)[0] / mm, size, atol=0.01)
    unit = re.search(r"stream\n(.*) cm\n", text)[1].split()
    np.testing.assert_allclose(np.array(unit, float) / mm, [1, 0, 0, -1, 0, size[1]], atol=0.01)

    squares = numbers(r"^(\S+) (\S+) (\S+) (\S+) re$", text)
    np.testing.assert_allclose(squares[:, 2:], CELL, atol=0.001)
    paths = re.findall(r"((?:^\S+ \S+ [ml]\n)+)s\n", text, re.MULTILINE)
    outlines = [numbers(r"^(\S+) (\S+)", path) for path in paths]
    for (cells, _), outline in zip((arch(), card()), outlines, strict=True):
        low, high = outline.min(0), outline.max(0)
        assert (low > 6).all(), "printers leave a margin"
        assert (high < np.array(size) - 6).all()
        np.testing.assert_allclose(high - low, CELL * np.flip(cells.shape), atol=0.001)
        for row, column in np.ndindex(cells.shape):
            place = low + CELL * (np.array([column, row]) + 0.5)
            inside = cv2.pointPolygonTest(outline.astype(np.float32), place.tolist(), False) > 0
            black = (np.abs(squares[:, :2] + CELL / 2 - place) < 0.01).all(1).any()
            assert (inside, black) == (cells[row, column] >= 0, cells[row, column] == 0)
    assert len(squares) == sum((cells == 0).sum() for cells, _ in (arch(), card()))

    lines = numbers(r"^(\S+) (\S+) m (\S+) (\S+) l$", text)
    ticks, base = lines[:-1], lines[-1]
    np.testing.assert_allclose(base[2] - base[0], 100)
    np.testing.assert_allclose(ticks[:, 0] - base[0], np.arange(101), atol=0.001)


def test_the_files_table_tells_where_its_objects_are(tmp_path):
    print_tags(tmp_path / "tags.pdf")
    file = (tmp_path / "tags.pdf").read_bytes()
    start = int(re.search(rb"startxref\n(\d+)\n%%EOF\n$", file)[1])
    assert file[start:].startswith(b"xref\n0 5\n")
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n \n", file[start:]), start=1):
        assert file[int(place) :].startswith(b"%d 0 obj\n" % number)
    length, stream = re.search(rb"/Length (\d+) >>\nstream\n(.*)\nendstream", file, re.S).groups()
    assert len(stream) == int(length)


def test_another_paper_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"paper is 'A5'.*allowed: A4, Letter"):
        print_tags(tmp_path / "tags.pdf", "A5")
    assert not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_written_leaves_the_file_as_it_is(tmp_path, monkeypatch):
    def full_disk(file):
        raise OSError("no space left")

    (tmp_path / "tags.pdf").write_bytes(b"before")
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="no space left"):
        print_tags(tmp_path / "tags.pdf")
    assert (tmp_path / "tags.pdf").read_bytes() == b"before"


@pytest.mark.slow
def test_tags_before_photographs_and_none_where_there_are_none():
    if not DEBIAN.exists():
        pytest.skip("needs Debian's package opencv-doc")
    photographs = [cv2.imread(str(DEBIAN / "data" / name))[..., ::-1] for name in PHOTOGRAPHS]
    assert_found(
        errors(
            random_frame(np.random.default_rng([1, i, j]), cut_out(photograph))
            for i, photograph in enumerate(photographs)
            for j in range(3)
        )
    )
    for path in DEBIAN.rglob("*.*"):  # drawings too
        image = cv2.imread(str(path)) if path.suffix in (".jpg", ".png") else None
        if image is not None:
            assert not TagTracker()(image[..., ::-1], image[..., ::-1])[1].any(), path
