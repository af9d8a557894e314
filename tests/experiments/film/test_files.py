"""Films are there as a whole, and can be read back, or they are not there at all."""

import cv2
import numpy as np
import pytest
from PIL import Image

from experiments.errors import ConfigError
from experiments.film.drawing import COLOURS
from experiments.film.files import FilmFiles

SIZE = (120, 90)


def files_in(folder, rate=8, gif_rate=4):
    return FilmFiles(folder, *SIZE, rate, 60, gif_rate)


def frame(grey):
    picture = np.full((SIZE[1], SIZE[0], 3), grey, np.uint8)
    picture[:20, :20] = COLOURS[4]  # the gripper's, in every frame
    return picture


def make(files, times, error=None):
    with files:
        files.add(frame(0), times)
        if error:
            raise error


def test_both_can_be_read_back(tmp_path):
    with files_in(tmp_path / "new") as files:
        for grey, times in ((40, 3), (80, 4), (120, 1), (200, 8)):
            files.add(frame(grey), times)
    assert (files.frames, files.seconds) == (16, 2.0)
    film = cv2.VideoCapture(str(files.mp4))
    assert film.get(cv2.CAP_PROP_FPS) == 8
    shown = []
    while (read := film.read())[0]:
        shown.append(read[1])
    assert [each.shape for each in shown] == [(90, 120, 3)] * 16
    greys = [40] * 3 + [80] * 4 + [120] + [200] * 8
    assert [abs(int(np.median(each)) - grey) < 6 for each, grey in zip(shown, greys, strict=True)] == [
        True
    ] * 16
    assert np.abs(shown[0][10, 10].astype(int) - COLOURS[4][::-1]).max() < 40, "blue and red are not swapped"
    gif = Image.open(files.gif)
    assert gif.size == (60, 45)
    durations, greys = [], []
    for k in range(gif.n_frames):
        gif.seek(k)
        pixels = np.asarray(gif.convert("RGB"))
        assert tuple(pixels[4, 4]) == COLOURS[4]
        durations.append(gif.info["duration"])
        greys.append(int(np.median(pixels)))
    assert sum(durations) == 2000
    assert greys == [40, 80, 200]  # at 0, 250 .. 750 and 1000 ms
    assert durations == [500, 500, 1000]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["film.gif", "film.mp4"]


def test_what_fails_leaves_nothing_and_overwrites_nothing(tmp_path):
    (tmp_path / "film.mp4").write_text("of yesterday")
    with pytest.raises(KeyboardInterrupt):
        make(files_in(tmp_path), 3, KeyboardInterrupt)
    with pytest.raises(ConfigError, match="nothing to show"), files_in(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
    assert (tmp_path / "film.mp4").read_text() == "of yesterday"


def test_a_film_with_frames_missing_is_refused(tmp_path):
    files = files_in(tmp_path)
    files.frames = 1
    with pytest.raises(ConfigError, match="4 of 5 frames were written"):
        make(files, 4)
    assert not list(tmp_path.iterdir())


def test_a_missing_codec_is_told_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.film.files.CODEC", "????")
    with (
        pytest.raises(ConfigError, match=r"cannot write it here.*opencv-python-headless"),
        files_in(tmp_path),
    ):
        pytest.fail("it began")
    assert not list(tmp_path.iterdir())
