"""What is filmed, without drawing it; what agents predict; what a film says in words."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from calfree_gym.image import lengths_px
from calfree_gym.robot.docking.model import pose_of
from experiments.film.command import (
    END,
    FLASH,
    FLASHES,
    LOOK,
    NEWS,
    FilmRecorder,
    Predictions,
    TrialStatus,
    caption,
    told,
)
from experiments.film.pictures import Trial

RATE = 20
KNOCK = {"type": "camera_aim", "camera": "left", "degrees": 15.0}
WORDS = np.array([0.3, 0.2, -0.2], np.float32)


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


@pytest.fixture
def recorded():
    """Makes an environment that is filmed and reset, and what was shot of it."""

    def recorded(task="Reach", first_trial=1, **settings):
        kinematic = {"dynamics": "kinematic"} if task == "Reach" else {}
        env = gym.make(f"CalFree/{task}-v0", world="wild", camera_mount="stand", **kinematic, **settings)
        shots = Shots()
        recorder = FilmRecorder(env, shots, shots.write, shots, RATE, "someone", first_trial)
        recorder.reset(seed=0)
        return recorder, shots

    return recorded


def joints(recorder):
    return recorder.unwrapped.arms.simulation.configuration(0)


def test_the_arm_moves_smoothly_from_look_to_look(recorded):
    recorder, shots = recorded()
    before = joints(recorder)
    (look,) = shots.all
    assert look[0] is None
    assert look[3] == round(RATE * LOOK)
    *_, info = recorder.step(WORDS)
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
    np.testing.assert_array_equal(last[1].points.reshape(4, 2), recorder.unwrapped.arms.delivered[0][0])
    assert last[2].caption.endswith(f"motion 1 · {info['truth']['error_px']:.0f} px off")
    seen = len(shots.all)
    recorder.step(np.zeros(3, np.float32))
    assert len(shots.all) == seen + 1, "a motion of zero words is a look only"


@pytest.mark.parametrize("clock", ["motion", "trial"])
def test_a_knock_is_announced_with_the_arm_where_it_was(recorded, clock):
    recorder, shots = recorded(perturbations=[{"at": {clock: 1}, "do": KNOCK}])
    recorder.step(WORDS)
    before, seen = joints(recorder), len(shots.all)
    if clock == "trial":
        recorder.reset()
    else:
        recorder.step(np.array([-0.3, 0.1, 0.1], np.float32))
    said = [shot for shot in shots.all if shot[2].announced]
    assert said == shots.all[seen : seen + 2 * FLASHES + 1]
    assert sum(times for *_, times, _ in said) == round(RATE * (2 * FLASHES * FLASH + NEWS))
    assert [alarm.flash for *_, alarm in said] == [True, False] * FLASHES + [False]
    for where, marks, words, _, alarm in said:
        assert words.announced == "left camera turned by 15°"
        assert (alarm.camera, alarm.now) == ("left", True)
        np.testing.assert_array_equal(where, before)
        assert (marks is None) == (clock == "trial")
        knocked = {"trial": (Trial(1), Trial(0, None, True)), "motion": (Trial(1, None, True),)}
        assert words.trials == knocked[clock]
    assert {(alarm.camera, alarm.now) for *_, alarm in shots.all[seen + len(said) :]} == {("left", False)}
    recorder.reset()
    assert shots.all[-1][-1].camera == "", "the next trial has no news"
    assert [kept.words for kept in shots.kept if kept.change] == ["left camera turned by 15°"]


def test_the_way_home_is_shown_and_the_end_of_a_trial_lasts(recorded):
    recorder, shots = recorded(max_episode_steps=1)
    home = joints(recorder)
    recorder.step(WORDS)
    assert shots.all[-1][3] == round(RATE * END)
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


def test_earlier_trials_are_made_but_not_shown(recorded):
    recorder, shots = recorded(first_trial=2)
    recorder.step(WORDS)
    assert not shots.all
    recorder.reset()
    assert len(shots.all) == 1
    assert "trial 2" in shots.all[0][2].caption
    assert shots.all[0][2].trials[0].motions == 1, "they are told"


def test_predictions_are_asked_for_the_executed_registers_and_stay_for_the_look(recorded):
    recorder, shots = recorded()
    asked = []

    def predicted(registers):
        asked.append(registers.copy())
        return np.full((4, 2), 0.1)

    recorder.predicted = predicted
    for k in range(2):  # the second is beyond the stops
        observation, *_ = recorder.step(np.array([1.0, 0.9, 0.5], np.float32))
        np.testing.assert_allclose(asked[k], observation["observation"][4:], rtol=1e-6)
    assert (asked[1] < [2.0, 1.8, 1.0]).all()
    assert shots.all[0][1].predicted is None
    assert all((each[1].predicted == 0.1).all() for each in shots.all[1:])


def test_what_is_predicted_comes_true_once_it_is_known_and_asking_changes_nothing(recorded):
    def life(watched):
        recorder, _ = recorded()
        agent, wrong = agents.make("memory", recorder), []
        arms = recorder.unwrapped.arms

        def predicted(registers):
            if not wrong:
                assert np.isnan(predictions.at(np.ones(3))).any(), "at first it knows nothing of far places"
            expected = predictions.at(registers)
            wrong.append(lengths_px(expected - arms.true_points[0]).max())
            return expected

        if watched:
            predictions = Predictions(agent)
            recorder.predicted = predicted
        recorder.reset(seed=3)
        agent.learn(60)
        return np.array(wrong), arms.simulation.joints()

    wrong, after = life(True)
    assert len(wrong) == 60
    assert np.nanmedian(wrong[30:]) < 4
    np.testing.assert_array_equal(after, life(False)[1])


def test_agents_without_such_expectations_predict_nothing(recorded):
    recorder, _ = recorded()
    for name in ("random", "paper_servo", "body_schema", "safe_start"):
        agent = agents.make(name, recorder)
        predictions = Predictions(agent)
        agent.learn(5)
        assert predictions.at(np.zeros(3)) is None


def test_what_the_physics_passed_is_shown_jaws_and_object_too(recorded):
    recorder, shots = recorded("Grasp")
    before = joints(recorder)
    recorder.step(np.array([0.2, 0.1, -0.1, 0.1, 1.0], np.float32))
    way = np.array([each[0] for each in shots.all[1:-1]])
    np.testing.assert_array_equal(way[-1], joints(recorder))
    assert (np.abs(np.diff(way, axis=0)).max(0) > 1e-3).sum() >= 7, "arm, turn and both jaws move"
    assert np.abs(way[0] - before).max() < np.abs(way[-1] - before).max()
    np.testing.assert_array_equal(shots.all[-1][1].target[0], recorder.unwrapped.arms.goals[0].reshape(2, 2))
    seen = len(shots.all)
    recorder.reset()
    home = shots.all[seen][0]
    np.testing.assert_array_equal(home[-7:], joints(recorder)[-7:], "the next object lies there")


@pytest.mark.parametrize(
    ("base", "dynamics"), [("differential", "kinematic"), ("omni", "kinematic"), ("differential", "physics")]
)
def test_a_base_rolls_along_the_arc_on_which_half_the_words_end_half_way(base, dynamics):
    words = np.array([0.3, 0.5, 0.1])[: 3 if base == "omni" else 2]
    env = gym.make("CalFree/Dock-v0", world="nominal", base=base, keep_in_view=False, dynamics=dynamics)
    simulation, ends = env.unwrapped.arms.simulation, []
    for share in (0, 0.5, 1):
        env.reset(seed=0, options={"pose": (-1, 0.1, 3.0)})
        env.step((share * words).astype(np.float32))
        ends.append(simulation.configuration(0))
    before, half, after = ends
    off = {"kinematic": 1e-6, "physics": 5e-3}[dynamics]
    np.testing.assert_allclose(pose_of(simulation.between(before, after, 0.5)), pose_of(half), atol=off)
    np.testing.assert_allclose(pose_of(simulation.between(before, after, 1.0)), pose_of(after), atol=1e-9)
    env.close()


def test_the_caption_says_where_a_trial_is():
    status = TrialStatus(3, 1, {"truth": {"error_px": 35.4}})
    assert caption("someone", status) == "someone · trial 3 · motion 1 · 35 px off"
    reached = status._replace(success=True, over=True)
    assert caption("someone", reached) == "someone · trial 3 · reached in 1 motion · 35 px off"
    missed = status._replace(motions=60, over=True)
    assert caption("someone", missed) == "someone · trial 3 · not reached in 60 motions · 35 px off"
    assert told(status._replace(motions=0)) == "reach 3: begins"
    assert told(reached) == "reach 3: 1 motion"
    assert told(missed) == "reach 3: 60 motions, in vain"


@pytest.mark.parametrize(
    ("info", "said"),
    [
        ({"truth": {"error_px": 9, "lifted_mm": 0.0}}, "not held"),
        ({"truth": {"error_px": 9, "lifted_mm": -0.1}}, "held"),
        ({"truth": {"error_px": 9, "lifted_mm": 81.7}}, "held, 82 mm up"),
        ({"truth": {"error_px": 9, "depth_mm": -20.0, "lateral_mm": 1.0}}, "peg outside the hole"),
        ({"truth": {"error_px": 9, "depth_mm": 12.2, "lateral_mm": 30.0}}, "peg outside the hole"),
        ({"truth": {"error_px": 9, "depth_mm": 12.2, "lateral_mm": 1.0}}, "peg 12 mm in the hole"),
        ({"truth": {"error_px": 9, "offset_mm": 41.6, "heading_deg": 3.2}}, "42 mm and 3° off"),
        ({"truth": {"error_px": 9}, "contacts": 0, "peak_force": 0.0}, "9 px off · touches nothing"),
        ({"truth": {"error_px": 9}, "contacts": 2, "peak_force": 8.6}, "9 px off · touches with 9 N"),
    ],
)
def test_each_task_tells_what_is_true_of_it(info, said):
    assert caption("someone", TrialStatus(1, 9, info)) == f"someone · trial 1 · motion 9 · {said}"


@pytest.mark.parametrize("name", ["Reach", "SafeReach", "Grasp", "Insert", "Dock"])
def test_every_environment_tells_it(name):
    env = gym.make(f"CalFree/{name}-v0")
    info = env.reset(seed=0)[1]
    words = caption("someone", TrialStatus(1, 0, info, success=True))
    done = {"Grasp": "lifted", "Insert": "inserted", "Dock": "docked"}.get(name, "reached")
    assert f" · {done} in 0 motions · " in words
    outcome = {
        "Grasp": "not held",
        "Insert": "peg outside the hole",
        "SafeReach": "touches nothing",
        "Dock": "° off",
    }
    assert words.endswith(outcome.get(name, "px off"))
    env.close()
