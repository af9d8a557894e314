"""Films are there as a whole, and can be read back, or they are not there at all."""

import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence

from calfree_gym.engine.frames import GRIPPER_COLOUR
from experiments.errors import ConfigError
from experiments.film.pictures import WIDTH, FilmFiles, Moment, chosen, frame_strip, moment

SIZE = (120, 90)


def files_in(folder, rate=8, gif_rate=4):
    return FilmFiles(folder, *SIZE, rate, 60, gif_rate)


def frame(grey):
    picture = np.full((SIZE[1], SIZE[0], 3), grey, np.uint8)
    picture[:20, :20] = GRIPPER_COLOUR  # in every frame
    return picture


def make(files, times, error=None):
    with files:
        files.add(frame(0), times)
        files.keep(moment(frame(0), "now"))
        if error:
            raise error


def test_all_can_be_read_back(tmp_path):
    with files_in(tmp_path / "new") as files:
        for grey, times in ((40, 3), (80, 4), (120, 1), (200, 8)):
            files.add(frame(grey), times)
            files.keep(moment(frame(grey), "then"))
    assert (files.frames, files.seconds) == (16, 2.0)
    film = cv2.VideoCapture(str(files.mp4))
    assert film.get(cv2.CAP_PROP_FPS) == 8
    shown = []
    while (read := film.read())[0]:
        shown.append(read[1])
    assert [each.shape for each in shown] == [(90, 120, 3)] * 16
    greys = [40] * 3 + [80] * 4 + [120] + [200] * 8
    assert np.abs(np.median(shown, (1, 2, 3)) - greys).max() < 6
    off = np.abs(shown[0][10, 10].astype(int) - np.array(GRIPPER_COLOUR)[::-1])
    assert off.max() < 40, "blue and red are not swapped"
    gif = Image.open(files.gif)
    assert gif.size == (60, 45)
    durations, greys = [], []
    for each in ImageSequence.Iterator(gif):
        pixels = np.asarray(each.convert("RGB"))
        assert tuple(pixels[4, 4]) == GRIPPER_COLOUR
        durations.append(each.info["duration"])
        greys.append(int(np.median(pixels)))
    assert sum(durations) == 2000
    assert greys == [40, 80, 200]  # at 0, 250 .. 750 and 1000 ms
    assert durations == [500, 500, 1000]
    written = sorted(path.name for path in (tmp_path / "new").iterdir())
    assert written == ["film.gif", "film.mp4", "film.png"]
    strip = np.asarray(Image.open(files.png).convert("RGB"))
    shown = [strip[100, 200 + k * (strip.shape[1] + 12) // 4].tolist() for k in range(4)]
    assert shown == [[grey] * 3 for grey in (40, 80, 120, 200)]


def moments(turns, change=None):
    return [Moment(np.full((9, WIDTH, 3), k, np.uint8), f"{k}", k in turns, k == change) for k in range(20)]


@pytest.mark.parametrize(
    ("turns", "change", "shown"),
    [
        (range(2, 20, 2), 8, [6, 8, 10, 12, 14]),  # from the turn before the change on
        (range(2, 20, 2), 2, [2, 4, 6, 8, 10]),
        (range(2, 20, 2), 18, [10, 12, 14, 16, 18]),
        (range(1, 10), None, [1, 3, 5, 7, 9]),
        ([19], None, [0, 5, 10, 14, 19]),  # of one trial, looks too
        ([3, 5, 9, 19], 5, [3, 5, 9, 19]),
    ],
)
def test_a_strip_shows_the_change_and_what_came_of_it(turns, change, shown):
    assert [int(each.words) for each in chosen(moments(turns, change))] == shown


def test_a_strip_has_moments_side_by_side_with_their_words_below():
    strip = frame_strip(moments([])[:2])
    assert strip.shape == (9 + 44, 2 * WIDTH + 12, 3)
    assert (strip[:9, WIDTH : WIDTH + 12] == 255).all()
    assert (strip[:9, WIDTH + 12 :] == 1).all()
    for left in (0, WIDTH + 12):
        assert (strip[9:, left : left + WIDTH] < 100).any(), "words"
    with pytest.raises(ValueError, match="no moments"):
        frame_strip([])


def test_what_fails_leaves_nothing_and_overwrites_nothing(tmp_path):
    (tmp_path / "film.mp4").write_text("of yesterday")
    with pytest.raises(KeyboardInterrupt):
        make(files_in(tmp_path), 3, KeyboardInterrupt)
    with pytest.raises(ConfigError, match="nothing to show"), files_in(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
    assert (tmp_path / "film.mp4").read_text() == "of yesterday"


def test_a_film_is_not_written_through_links(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    for ending in ("mp4", "gif", "png"):
        (tmp_path / f".film.partial.{ending}").symlink_to(tmp_path / "thesis.txt")
    files = files_in(tmp_path)
    make(files, 8)
    assert (tmp_path / "thesis.txt").read_text() == "mine"
    assert files.gif.exists()


def test_a_film_with_frames_missing_is_refused(tmp_path):
    files = files_in(tmp_path)
    files.frames = 1
    with pytest.raises(ConfigError, match="4 of 5 frames were written"):
        make(files, 4)
    assert not list(tmp_path.iterdir())


def test_a_missing_codec_is_told_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.film.pictures.CODEC", "????")
    with pytest.raises(ConfigError, match=r"cannot write it here.*opencv-python-headless"):
        make(files_in(tmp_path), 1)
    assert not list(tmp_path.iterdir())


def test_a_gif_lasts_as_long_as_the_film(tmp_path):
    with files_in(tmp_path / "new", rate=48, gif_rate=48) as files:
        for grey in range(48):
            files.add(frame(4 * grey), 1)
        files.keep(moment(frame(0), "now"))
    assert sum(each.info["duration"] for each in ImageSequence.Iterator(Image.open(files.gif))) == 1000
