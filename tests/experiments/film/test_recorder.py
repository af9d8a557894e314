"""What is filmed, without drawing it."""

import gymnasium as gym
import numpy as np
import pytest

from experiments.film.pictures import Trial
from experiments.film.recorder import PACE, FilmRecorder, eased

RATE = 20
KNOCK = {"type": "camera_aim", "camera": "left", "degrees": 15.0}


class Shots:
    """Keeps what was to be drawn: configuration, marks, words, for how many frames, and the alarm."""

    def __init__(self):
        self.all, self.kept = [], []

    def draw(self, configuration, marks, alarm):
        self.all.append([configuration, marks])
        self.alarm = alarm
        return np.zeros((2, 2, 3), np.uint8)

    def write(self, picture, words):
        self.all[-1].append(words)
        return picture

    def add(self, picture, times):
        self.all[-1] += [times, self.alarm]

    def keep(self, moment):
        self.kept.append(moment)


def recorded(first_trial=1, perturbations=None, **settings):
    env = gym.make(
        "CalFree/Reach-v0",
        world="wild",
        camera_mount="stand",
        dynamics="kinematic",
        perturbations=perturbations,
        **settings,
    )
    shots = Shots()
    return FilmRecorder(env, shots, shots.write, shots, RATE, "someone", first_trial), shots


def joints(recorder):
    return recorder.unwrapped.arms.simulation.configuration(0)


def test_the_arm_moves_smoothly_from_look_to_look():
    recorder, shots = recorded()
    recorder.reset(seed=0)
    before = joints(recorder)
    (look,) = shots.all
    assert look[0] is None
    assert look[3] == round(RATE * PACE.look)
    *_, info = recorder.step(np.array([0.3, 0.2, -0.2], np.float32))
    _, *way, last = shots.all
    places = np.array([before, *(each[0] for each in way)])
    np.testing.assert_allclose(places[-1], joints(recorder))
    assert len(way) == round(RATE * (info["robot_seconds"] - 4.0)) > 4
    steps = np.abs(np.diff(places, axis=0)).sum(1)
    assert (steps > 0).all()
    assert max(steps[0], steps[-1]) < steps.max() / 2, "it starts and ends slowly"
    assert [each[3] for each in way] == [1] * len(way)
    assert not any(each[1].seen.any() for each in way), "it does not look on its way"
    assert last[1].seen.any()
    np.testing.assert_array_equal(last[1].points, recorder.unwrapped.arms.delivered[0][0])
    assert last[2].caption.endswith(f"motion 1 · {info['truth']['error_px']:.0f} px off")


def test_a_motion_of_zero_words_is_a_look_only():
    recorder, shots = recorded()
    recorder.reset(seed=0)
    recorder.step(np.zeros(3, np.float32))
    assert len(shots.all) == 2


@pytest.mark.parametrize("clock", ["motion", "trial"])
def test_a_knock_is_announced_with_the_arm_where_it_was(clock):
    recorder, shots = recorded(perturbations=[{"at": {clock: 1}, "do": KNOCK}])
    recorder.reset(seed=0)
    recorder.step(np.array([0.3, 0.2, -0.2], np.float32))
    before, seen = joints(recorder), len(shots.all)
    if clock == "trial":
        recorder.reset()
    else:
        recorder.step(np.array([-0.3, 0.1, 0.1], np.float32))
    said = [shot for shot in shots.all if shot[2].announced]
    assert said == shots.all[seen : seen + 2 * PACE.flashes + 1]
    assert sum(times for *_, times, _ in said) == round(RATE * (2 * PACE.flashes * PACE.flash + PACE.news))
    assert [alarm.flash for *_, alarm in said] == [True, False] * PACE.flashes + [False]
    for where, marks, words, _, alarm in said:
        assert words.announced == "left camera turned by 15°"
        assert (alarm.camera, alarm.now) == ("left", True)
        np.testing.assert_array_equal(where, before)
        assert (marks is None) == (clock == "trial")
        assert words.trials == (
            (Trial(1), Trial(0, None, True)) if clock == "trial" else (Trial(1, None, True),)
        )
    assert {(alarm.camera, alarm.now) for *_, alarm in shots.all[seen + len(said) :]} == {("left", False)}
    recorder.reset()
    assert shots.all[-1][-1].camera == "", "the next trial has no news"
    assert [kept.words for kept in shots.kept if kept.change] == ["left camera turned by 15°"]


def test_the_way_home_is_shown_and_the_end_of_a_trial_lasts():
    recorder, shots = recorded(max_episode_steps=1)
    recorder.reset(seed=0)
    home = joints(recorder)
    recorder.step(np.array([0.3, 0.2, -0.2], np.float32))
    assert shots.all[-1][3] == round(RATE * PACE.end)
    assert "not reached in 1 motion" in shots.all[-1][2].caption
    far, seen = joints(recorder), len(shots.all)
    recorder.reset()
    way = shots.all[seen:-1]
    assert len(way) > 4
    assert np.abs(way[0][0] - far).max() < 0.1 < np.abs(far - home).max()
    np.testing.assert_allclose(way[-1][0], home)
    assert {each[1] for each in way} == {None}
    assert "trial 2 · motion 0" in shots.all[-1][2].caption
    assert shots.all[-1][2].trials == (Trial(1, False), Trial())
    assert [kept.words for kept in shots.kept if kept.turn] == ["reach 1: 1 motion, in vain"]


def test_earlier_trials_are_made_but_not_shown():
    recorder, shots = recorded(first_trial=2)
    recorder.reset(seed=0)
    recorder.step(np.array([0.3, 0.2, -0.2], np.float32))
    assert not shots.all
    recorder.reset()
    assert len(shots.all) == 1
    assert "trial 2" in shots.all[0][2].caption
    assert shots.all[0][2].trials[0].motions == 1, "they are told"


def test_predictions_are_asked_for_the_executed_registers_and_stay_for_the_look():
    recorder, shots = recorded()
    asked = []

    def predicted(registers):
        asked.append(registers.copy())
        return np.full((4, 2), 0.1)

    recorder.predicted = predicted
    recorder.reset(seed=0)
    assert not asked
    for k in range(2):  # the second is beyond the stops
        observation, *_ = recorder.step(np.array([1.0, 0.9, 0.5], np.float32))
        np.testing.assert_allclose(asked[k], observation["observation"][4:], rtol=1e-6)
    assert (asked[1] < [2.0, 1.8, 1.0]).all()
    assert shots.all[0][1].predicted is None
    assert all((each[1].predicted == 0.1).all() for each in shots.all[1:])


def test_a_way_ends_where_it_is_to_end():
    shares = list(eased(7))
    assert len(shares) == 7
    assert shares[-1] == 1
    assert list(eased(1)) == [1]


def test_what_the_physics_passed_is_shown_jaws_and_object_too():
    env = gym.make("CalFree/Grasp-v0", world="wild", camera_mount="stand")
    shots = Shots()
    recorder = FilmRecorder(env, shots, shots.write, shots, RATE, "someone")
    recorder.reset(seed=0)
    before = recorder.unwrapped.arms.simulation.configuration(0)
    recorder.step(np.array([0.2, 0.1, -0.1, 0.1, 1.0], np.float32))
    way = np.array([each[0] for each in shots.all[1:-1]])
    np.testing.assert_array_equal(way[-1], recorder.unwrapped.arms.simulation.configuration(0))
    assert (np.abs(np.diff(way, axis=0)).max(0) > 1e-3).sum() >= 7, "arm, turn and both jaws move"
    assert np.abs(way[0] - before).max() < np.abs(way[-1] - before).max()
    np.testing.assert_array_equal(shots.all[-1][1].target, env.unwrapped.arms.goals[0].reshape(2, 2))
    seen = len(shots.all)
    recorder.reset()
    home = shots.all[seen][0]
    np.testing.assert_array_equal(
        home[-7:], recorder.unwrapped.arms.simulation.configuration(0)[-7:], "the next object lies there"
    )
