import numpy as np
import pytest

from experiments.evaluation import TrialRecord
from experiments.running.lifetime import Life
from tests.experiments.fakes import CountdownEnv

WORD = np.array([0.5], np.float32)


def make_trial(life: Life) -> None:
    over = False
    while not over:
        _, _, terminated, truncated, _ = life.step(WORD)
        over = terminated or truncated


def test_the_world_belongs_to_the_run():
    env = CountdownEnv()
    life = Life(env, seed=5)
    life.reset(seed=99)
    make_trial(life)
    life.reset(seed=98)
    assert env.seeds == [5, None]


def test_trials_are_the_same_however_often_an_agent_resets():
    records: list[list[TrialRecord]] = [[], []]
    for resets, log in zip((1, 3), records, strict=True):
        life = Life(CountdownEnv(), seed=5, on_trial=log.append)
        for _ in range(4):
            for _ in range(resets):
                life.reset()
            make_trial(life)
    assert records[0] == records[1]
    assert [record.trial for record in records[0]] == [0, 1, 2, 3]


def test_a_repeated_first_look_is_a_new_object():
    life = Life(CountdownEnv(), seed=5)
    first, first_info = life.reset()
    second, second_info = life.reset()
    assert first is not second
    assert first_info is not second_info
    np.testing.assert_array_equal(first, second)


def test_motions_and_perturbations_are_counted_over_trials():
    life = Life(CountdownEnv(perturb_motion=4), seed=5)
    since = [life.since_perturbation]
    for _ in range(6):
        _, _, terminated, _, _ = life.step(WORD)
        since.append(life.since_perturbation)
        if terminated:
            life.reset()
    assert (life.motions, life.trials) == (6, 1)
    assert since == [None] * 5 + [1, 2]
    assert life.perturbations == [(4, 0, {"type": "shake", "degrees": 3.0})]


def test_a_trial_that_is_cut_off_is_not_recorded():
    records: list[TrialRecord] = []
    life = Life(CountdownEnv(), seed=5, on_trial=records.append)
    life.step(WORD)
    life.reset()
    make_trial(life)
    assert [record.trial for record in records] == [1]


def test_what_a_reset_perturbs_belongs_to_the_next_motion():
    env = CountdownEnv(perturb_trial=1)
    life = Life(env, seed=5)
    at_first = life.world
    make_trial(life)
    motions = life.motions
    life.reset()
    assert env.world is not at_first
    assert (life.world, life.perturbations, life.since_perturbation) == (at_first, [], None)
    life.step(WORD)
    assert life.world is env.world
    assert life.perturbations == [(motions, 1, {"type": "shake", "degrees": 3.0})]
    assert life.since_perturbation == 1


def test_a_life_may_begin_perturbed():
    life = Life(CountdownEnv(perturb_trial=0), seed=5)
    assert life.perturbations == [(0, 0, {"type": "shake", "degrees": 3.0})]
    assert life.since_perturbation == 0


def test_trials_take_no_options():
    life = Life(CountdownEnv(), seed=5)
    with pytest.raises(ValueError, match=r"got options \{'object': \(0, 0, 0\)\}"):
        life.reset(options={"object": (0, 0, 0)})
