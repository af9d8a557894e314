"""The tracker before photographs, and before much of a mark's own colour."""

import matplotlib.cbook
import numpy as np
import PIL.Image
import pytest

from calfree_gym.vision.marks import MARK_NAMES, Marks
from calfree_gym.vision.tracking.blobs import ColourTable
from calfree_gym.vision.tracking.tracker import BallFinder
from tests.calfree_gym.vision.accuracy import compared
from tests.calfree_gym.vision.drawings import COLOURS, Canvas, cut_out, drawn


def test_balls_before_a_photograph_of_much_blue_and_red():
    """A portrait that comes with matplotlib: a navy coat, and a flag."""
    with matplotlib.cbook.get_sample_data("grace_hopper.jpg") as file:
        photograph = np.array(PIL.Image.open(file).convert("RGB"))
    found, _ = compared(drawn(4, 60, hide=0.3, behind=cut_out(photograph)))
    error = found[found[:, 0] > 0.95, 1]
    assert len(error) > 100
    assert np.isfinite(error).mean() >= 0.95
    assert np.nanmedian(error) <= 0.25
    assert (error[np.isfinite(error)] <= 1).mean() >= 0.95
    assert np.isfinite(found[found[:, 0] == 0, 1]).mean() <= 0.05


@pytest.mark.parametrize("name", MARK_NAMES)
def test_a_ball_before_a_large_thing_of_a_colour_like_its_own(name):
    greyish = 0.45 * np.array(COLOURS[name]) + 60
    canvas = Canvas(np.full((256, 256, 3), 120.0))
    canvas.polygon([(20, 20), (230, 30), (240, 240), (30, 220)], greyish)
    canvas.ball(name, (100.0, 120.0), 8.0, COLOURS[name], np.random.default_rng(0))
    image = canvas.picture.round().astype(np.uint8)
    assert (ColourTable(Marks()).marks_of(image[128, 200]) == 1 + MARK_NAMES.index(name)).all()
    balls = BallFinder(Marks())(image)
    assert set(balls) == {name}
    assert np.hypot(*(balls[name].centre - (100, 120))) < 0.25


def test_a_ball_among_many_larger_things_of_its_colour_that_are_not_round():
    rng = np.random.default_rng(5)
    canvas = Canvas(np.full((480, 640, 3), 120.0))
    for x in range(40, 640, 80):
        canvas.polygon([(x, 30), (x + 6, 30), (x + 6, 110), (x, 110)], COLOURS["object"])
    canvas.ball("object", (320.0, 300.0), 8.0, COLOURS["object"], rng)
    balls = BallFinder(Marks())(canvas.picture.round().astype(np.uint8))
    assert np.hypot(*(balls["object"].centre - (320, 300))) < 0.25
