import gymnasium as gym
import numpy as np
import pytest

from experiments.evaluation import TrialRecord
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from tests.experiments.fakes import CountdownEnv, Repeater

WORD = np.array([0.5], np.float32)


def make_trial(recorder: LifetimeRecorder) -> None:
    over = False
    while not over:
        _, _, terminated, truncated, _ = recorder.step(WORD)
        over = terminated or truncated


def test_the_world_belongs_to_the_run():
    env = CountdownEnv()
    recorder = LifetimeRecorder(env, seed=5)
    recorder.reset(seed=99)
    make_trial(recorder)
    recorder.reset(seed=98)
    assert env.seeds == [5, None]


def test_trials_are_the_same_however_often_an_agent_resets():
    records: list[list[TrialRecord]] = [[], []]
    for resets, log in zip((1, 3), records, strict=True):
        recorder = LifetimeRecorder(CountdownEnv(), seed=5, on_trial=log.append)
        for _ in range(4):
            for _ in range(resets):
                recorder.reset()
            make_trial(recorder)
    assert records[0] == records[1]
    assert [record.trial for record in records[0]] == [0, 1, 2, 3]


def test_objects_come_again_at_the_same_places_and_other_trials_do_not_change():
    def lived(places):
        env = gym.make("calfree_gym:CalFree/Reach-v0", dynamics="kinematic", max_episode_steps=1)
        recorder, objects, seen = LifetimeRecorder(env, seed=5, places=places), [], []
        for _ in range(7):
            observation, info = recorder.reset()
            objects.append(info["truth"]["object"])
            seen.append(observation["desired_goal"])
            recorder.step(np.zeros(3, np.float32))
        return np.array(objects), np.array(seen)

    objects, seen = lived(3)
    others, _ = lived(None)
    np.testing.assert_array_equal(objects[:3], others[:3])
    np.testing.assert_allclose(objects[3:6], objects[:3], atol=1e-12)
    np.testing.assert_allclose(objects[6], objects[0], atol=1e-12)
    assert len(np.unique(others, axis=0)) == 7
    assert len(np.unique(seen, axis=0)) == 7  # by the noise


def test_a_repeated_first_observation_is_a_new_object():
    recorder = LifetimeRecorder(CountdownEnv(), seed=5)
    first, first_info = recorder.reset()
    second, second_info = recorder.reset()
    assert first is not second
    assert first_info is not second_info
    np.testing.assert_array_equal(first, second)


def test_motions_and_perturbations_are_counted_over_trials():
    recorder = LifetimeRecorder(CountdownEnv(perturb_motion=4), seed=5)
    since = [recorder.since_perturbation]
    for _ in range(6):
        _, _, terminated, _, _ = recorder.step(WORD)
        since.append(recorder.since_perturbation)
        if terminated:
            recorder.reset()
    assert (recorder.motions, recorder.trials) == (6, 1)
    assert since == [None] * 5 + [1, 2]
    assert recorder.perturbations == [(4, 0, {"type": "shake", "degrees": 3.0})]


def test_a_trial_that_is_cut_off_is_not_recorded():
    records: list[TrialRecord] = []
    recorder = LifetimeRecorder(CountdownEnv(), seed=5, on_trial=records.append)
    recorder.step(WORD)
    recorder.reset()
    make_trial(recorder)
    assert [record.trial for record in records] == [1]


def test_what_a_reset_perturbs_belongs_to_the_next_motion():
    env = CountdownEnv(perturb_trial=1)
    recorder = LifetimeRecorder(env, seed=5)
    at_first = recorder.world
    make_trial(recorder)
    motions = recorder.motions
    recorder.reset()
    assert env.world is not at_first
    assert (recorder.world, recorder.perturbations, recorder.since_perturbation) == (at_first, [], None)
    recorder.step(WORD)
    assert recorder.world is env.world
    assert recorder.perturbations == [(motions, 1, {"type": "shake", "degrees": 3.0})]
    assert recorder.since_perturbation == 1


def test_a_lifetime_may_begin_perturbed():
    recorder = LifetimeRecorder(CountdownEnv(perturb_trial=0), seed=5)
    assert recorder.perturbations == [(0, 0, {"type": "shake", "degrees": 3.0})]
    assert recorder.since_perturbation == 0


def test_trials_take_no_options():
    recorder = LifetimeRecorder(CountdownEnv(), seed=5)
    with pytest.raises(ValueError, match=r"got options \{'object': \(0, 0, 0\)\}"):
        recorder.reset(options={"object": (0, 0, 0)})


def test_learning_stops_with_the_trial_that_was_asked_for():
    recorder, motions = LifetimeRecorder(CountdownEnv(), seed=5), []
    records = learn_trials(Repeater(recorder), recorder, 3, lambda: motions.append(recorder.motions))
    assert [record.trial for record in records] == [0, 1, 2]
    assert records is recorder.records
    assert motions == list(range(1, recorder.motions + 1))
    assert recorder.motions == sum(record.motions for record in records)
