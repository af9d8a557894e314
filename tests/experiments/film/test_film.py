"""The command, from YAML to files, and what is drawn."""

import cv2
import gymnasium as gym
import numpy as np
import pytest
from PIL import Image, ImageSequence

from calfree_gym.engine.frames import GRIPPER_COLOUR, SceneFrame
from experiments.__main__ import main
from experiments.film.pictures import ALARM, SUCCESS, Alarm, Lettering, Markings, Screen, ScreenWords, Trial


def near(frame, colour):
    return (np.abs(frame.astype(int) - colour) < 40).all(-1)


@pytest.mark.parametrize("learn", [True, False])
def test_a_film_is_made_and_the_arm_moves_in_it(film_data, write_config, tmp_path, capsys, learn):
    out = tmp_path / "deep" / "out"
    path = write_config({**film_data, "learn": learn, "first_trial": 1 if learn else 2})
    assert main(["film", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert f"film: {out / 'film.mp4'}" in said
    assert said.count("trial ") == 2
    film, frames = cv2.VideoCapture(str(out / "film.mp4")), []
    while (read := film.read())[0]:
        frames.append(read[1][..., ::-1].astype(int))
    assert {frame.shape for frame in frames} == {(156, 216, 3)}
    gif = Image.open(out / "film.gif")
    assert gif.size == (120, 87)
    lasts = sum(each.info["duration"] for each in ImageSequence.Iterator(gif))
    assert abs(lasts / 1000 - len(frames) / 8) <= 0.25
    scene = np.array([frame[20:120, :140] for frame in frames])
    changed = np.abs(np.diff(scene, axis=0)).max((1, 2, 3)) > 60
    assert changed.sum() > 5, "the arm moves"
    assert not changed.all(), "and rests"
    told = np.array([near(frame[2:8, 2:20], ALARM).all() for frame in frames])
    assert told.sum() == (12 if learn else 0), "6 flashes and 0.8 s; evaluated, the knock comes unseen"
    assert (out / "film.png").exists()


@pytest.mark.parametrize(("key", "value"), [("agent", "nobody"), ("colour", 1)])
def test_bad_input_ends_with_2_and_leaves_nothing(film_data, write_config, tmp_path, capsys, key, value):
    out = tmp_path / "out"
    assert main(["film", str(write_config({**film_data, key: value})), "--out", str(out)]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert not out.exists()


def test_without_opengl_the_error_is_one_line(film_data, write_config, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "none")
    assert main(["film", str(write_config(film_data)), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "MUJOCO_GL names no renderer" in line
    assert not list((tmp_path / "out").iterdir())


def test_marks_and_alarms_are_drawn_where_they_belong():
    env = gym.make("CalFree/Reach-v0", world="nominal", dynamics="kinematic")
    env.reset(seed=0)
    screen = Screen(env.unwrapped, 324, 216, sensors=False)
    nothing = screen.draw(None, None)
    assert nothing.shape == (216, 324, 3)
    points = np.array([[[0.5, 0.5], [-0.5, -0.5]], [[0.9, -0.9], [0.9, -0.9]]])
    seen = np.ones((2, 2), bool)
    expected = np.array([[0.0, 0.5], [np.nan, np.nan], [0.9, 0.9], [0.9, 0.9]])
    marked = screen.draw(None, Markings(points, seen, points[1:], expected))
    new = near(marked, GRIPPER_COLOUR) & ~near(nothing, GRIPPER_COLOUR)
    left, right = new[:108, 216:], new[108:216, 216:]
    assert left[78:84, 51:57].any(), "the gripper's cross, left"
    assert left[74:88, 76:86].any(), "its ring"
    rows, columns = np.nonzero(right)
    assert rows.max() < 40, "a ring, and no cross where nothing is expected"
    assert columns.max() < 40
    alarmed = screen.draw(None, None, Alarm("left", now=True))
    flashing = screen.draw(None, None, Alarm("left", now=True, flash=True))
    for picture in (alarmed, flashing):
        assert near(picture[:108, -1], ALARM).all()
        assert not near(picture[108:216, -1], ALARM).any()
        assert near(picture[:, :216], ALARM).sum() > 50, "the camera's ring in the scene"
    image = np.s_[20:90, 230:310]
    off = [np.abs(each[image].astype(int) - nothing[image]).mean() for each in (alarmed, flashing)]
    assert off[0] < 1 < 20 < off[1]
    outside = np.array([[1.2, 0.0], [np.nan, 0.0], [1.2, 0.0], [np.nan, 0.0]])
    unseen = screen.draw(None, Markings(points, seen, points[1:], outside))
    without = screen.draw(None, Markings(points, seen, points[1:]))
    np.testing.assert_array_equal(unseen, without, "a cross outside the image is not drawn")
    moved = screen.draw(env.unwrapped.arms.simulation.configuration(0) + 0.3, None)
    assert (np.abs(moved.astype(int) - nothing)[:, :216].max(-1) > 60).sum() > 300
    screen.close()
    env.close()


def test_a_camera_is_ringed_where_its_housing_is_drawn(opengl):
    env = gym.make("CalFree/Reach-v0", world="nominal", camera_mount="stand")
    env.reset(seed=0)
    frame = SceneFrame(env.unwrapped.arms, 540, 360, as_agents_see=False)
    scene = frame.views(0)[0]
    for camera in range(2):
        x, y = frame.camera_in_scene(camera)
        housing = scene[round(y) - 3 : round(y) + 4, round(x) - 3 : round(x) + 4]
        assert housing.max() < 110, "the housing is dark"
        assert scene[round(y), round(x) + 25 : round(x) + 35].min() > 190, "the room is light"
    frame.close()
    env.close()


def test_a_base_is_filmed_with_what_its_camera_sees_and_its_camera_is_ringed():
    env = gym.make("CalFree/Dock-v0", world="wild")
    env.reset(seed=0, options={"pose": (-0.6, 0, 0)})
    arms = env.unwrapped.arms
    screen = Screen(env.unwrapped, 324, 216, sensors=False)
    bare = screen.draw(None, None)
    points, seen, own = arms.shown(0)
    green = bare.astype(int)[..., 1] - bare[..., 0]
    pixels = np.round((points[:4, 0] + 1) * 54 - 0.5).astype(int) + np.array([216, 0])
    assert all(green[y - 1 : y + 2, x - 1 : x + 2].max() > 90 for x, y in pixels), "balls are at image points"
    marked = screen.draw(None, Markings(points, seen, own), Alarm("front", now=True))
    assert near(marked, GRIPPER_COLOUR)[:108, 216:].sum() > near(bare, GRIPPER_COLOUR)[:108, 216:].sum() + 50
    assert near(marked[:108, -1], ALARM).all()
    assert near(marked[:, :210], ALARM).sum() > 50
    ahead = arms.simulation.configuration(0)
    ahead[0] += 0.3
    moved = screen.draw(ahead, None)
    assert (moved[:, :210] != bare[:, :210]).any()
    assert (moved[:108, 216:] != bare[:108, 216:]).any()
    screen.close()
    env.close()


def test_words_are_written_where_they_belong():
    lettering, picture = Lettering(324, 216, 36), np.full((216, 324, 3), 128, np.uint8)
    nothing = lettering.write(picture, ScreenWords(""))
    assert nothing.shape == (252, 324, 3)
    said = lettering.write(picture, ScreenWords("a rather long caption " * 4))
    assert (said[216:] != nothing[216:]).any()
    assert (said[216:, 212:] == nothing[216:, 212:]).all(), "it fits"
    told = lettering.write(picture, ScreenWords("", announced="left"))
    assert near(told[2, 2:214], ALARM).all()
    assert (told[:216, 220:] == 128).all()
    trials = (Trial(8, True), Trial(2, True), Trial(4, None, knocked=True))
    knocked = lettering.write(picture, ScreenWords("", trials=trials))[216:]
    high = np.sort(near(knocked, SUCCESS)[:, 216:].sum(0))[::-1]
    assert high[0] == pytest.approx(4 * high[high > 0][-1], rel=0.35)
    assert near(knocked, ALARM).any()
    assert not near(lettering.write(picture, ScreenWords("", trials=trials[:2]))[216:], ALARM).any()
