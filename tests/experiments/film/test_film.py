"""The command, from YAML to files; what is drawn; what agents predict."""

import cv2
import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

import agents
from calfree_gym.envs.rendering.scene_frame import GRIPPER_COLOUR
from calfree_gym.image import lengths_px
from experiments.__main__ import main
from experiments.film.drawing import ALARM, Marks, Screen, Words, draw_crosses
from experiments.film.predictions import Predictions
from experiments.film.recorder import FilmRecorder


def frames_of(path):
    film, frames = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        frames.append(read[1][..., ::-1].astype(int))
    return frames


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
    frames = frames_of(out / "film.mp4")
    assert {frame.shape for frame in frames} == {(156, 216, 3)}
    gif = Image.open(out / "film.gif")
    assert gif.size == (120, 87)
    lasts = 0
    for k in range(gif.n_frames):
        gif.seek(k)
        lasts += gif.info["duration"]
    assert abs(lasts / 1000 - len(frames) / 8) <= 0.25
    scene = np.array([frame[20:120, :144] for frame in frames])
    changed = np.abs(np.diff(scene, axis=0)).max((1, 2, 3)) > 60
    assert changed.sum() > 5, "the arm moves"
    assert not changed.all(), "and rests"
    told = np.array([near(frame[2:8, 2:20], ALARM).all() for frame in frames])
    assert told.sum() == (13 if learn else 0), "1.6 s of 8 frames; evaluated, the knock comes unseen"


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
    assert not (tmp_path / "out").exists()


def test_marks_and_words_are_drawn_where_they_belong():
    env = gym.make("CalFree/Reach-v0", world="nominal", dynamics="kinematic")
    env.reset(seed=0)
    screen = Screen(env.unwrapped.arms, 324, 234, 18, sensors=False)
    nothing = screen.draw(None, None, Words(""))
    assert nothing.shape == (234, 324, 3)
    points = np.array([[0.5, 0.5], [-0.5, -0.5], [0.9, -0.9], [0.9, -0.9]])
    expected = np.array([[0.0, 0.5], [np.nan, np.nan], [0.9, 0.9], [0.9, 0.9]])
    marked = screen.draw(None, Marks(points, np.ones(4, bool), points[2:], expected), Words(""))
    new = near(marked, GRIPPER_COLOUR) & ~near(nothing, GRIPPER_COLOUR)
    left, right = new[:108, 216:], new[108:216, 216:]
    assert left[78:84, 51:57].any(), "the gripper's cross, left"
    assert left[74:88, 76:86].any(), "its ring"
    rows, columns = np.nonzero(right)
    assert rows.max() < 40, "a ring, and no cross where nothing is expected"
    assert columns.max() < 40
    caption = screen.draw(None, None, Words("a rather long caption " * 4))[216:]
    assert (caption != nothing[216:]).any()
    assert (caption[:, -4:] == nothing[216:][:, -4:]).all(), "it fits"
    told = screen.draw(None, None, Words("", announced="left", camera="left"))
    assert near(told[2, 2:214], ALARM).all()
    assert near(told[:108, -1], ALARM).all()
    assert not near(told[108:216, -1], ALARM).any()
    moved = screen.draw(env.unwrapped.arms.simulation.configuration(0) + 0.3, None, Words(""))
    assert (np.abs(moved.astype(int) - nothing)[:, :216].max(-1) > 60).sum() > 300
    screen.close()
    env.close()


def test_a_cross_outside_the_image_is_not_drawn():
    image = np.zeros((50, 50, 3), np.uint8)
    draw_crosses(image, np.array([[1.2, 0.0], [np.nan, 0.0]]))
    assert not image.any()


class Nowhere:
    """Draws nothing."""

    def draw(self, configuration, marks, words):
        return np.zeros((2, 2, 3), np.uint8)


def test_what_is_predicted_comes_true_once_it_is_known_and_asking_changes_nothing():
    def life(watched):
        env = gym.make("CalFree/Reach-v0", world="wild", dynamics="kinematic", camera_mount="stand")
        recorder = FilmRecorder(env, Nowhere(), lambda picture, times: None, 2, "")
        agent, wrong = agents.make("memory", recorder), []

        def predicted(registers):
            if not wrong:
                assert np.isnan(predictions.at(np.ones(3))).any(), "at first it knows nothing of far places"
            expected = predictions.at(registers)
            wrong.append(lengths_px(expected - env.unwrapped.arms.true_points[0]).max())
            return expected

        if watched:
            predictions = Predictions(agent)
            recorder.predicted = predicted
        recorder.reset(seed=3)
        agent.learn(60)
        return np.array(wrong), joints_of(env)

    def joints_of(env):
        return env.unwrapped.arms.simulation.joints()

    wrong, after = life(True)
    assert len(wrong) == 60
    assert np.nanmedian(wrong[30:]) < 4
    np.testing.assert_array_equal(after, life(False)[1])


def test_agents_without_such_expectations_predict_nothing():
    env = gym.make("CalFree/Reach-v0", world="wild", dynamics="kinematic")
    for name in ("random", "paper_servo", "body_schema", "safe_start"):
        agent = agents.make(name, env)
        predictions = Predictions(agent)
        agent.learn(5)
        assert predictions.at(np.zeros(3)) is None
    env.close()
