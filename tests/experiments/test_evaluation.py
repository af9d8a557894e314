import random

import gymnasium as gym
import numpy as np
import pytest

import agents
from experiments.evaluation import evaluate
from tests.experiments.fakes import CountdownEnv, Halver


def test_records_tell_what_happened():
    env = CountdownEnv()
    records = evaluate(Halver(), env, trials=5, seed=7)
    starts = np.random.default_rng(7).uniform(20, 200, 5)
    for trial, (record, start) in enumerate(zip(records, starts, strict=True)):
        motions = int(np.ceil(np.log2(start / 4)))
        assert (record.trial, record.motions, record.success) == (trial, motions, True)
        assert record.robot_seconds == pytest.approx(1.5 * motions)
        assert record.error_px == pytest.approx(start / 2**motions)
        assert record.distance_mm == pytest.approx(2 * record.error_px)
        assert record.motions_to[4] == motions
        assert record.motions_to[16] == max(1, np.ceil(np.log2(start / 16)))
        assert record["motions"] == record.motions
    assert env.seeds == [7, None, None, None, None]


def test_a_failed_trial_ends_at_the_cap():
    (record,) = evaluate(Halver(word=1.0), CountdownEnv(), trials=1, seed=0)
    assert record.motions == 10
    assert not record.success
    assert record.motions_to == {2: None, 4: None, 8: None, 16: None}


def test_success_allows_three_sigma_of_the_noise():
    env = CountdownEnv()
    env.reset(seed=3)
    word = (5.4 / env.error) ** 0.1  # 5.4 px after 10 motions: within 4 + 3 × 0.5
    assert evaluate(Halver(word), env, trials=1, seed=3)[0].success
    env.world.point_noise = 0.4
    assert not evaluate(Halver(word), env, trials=1, seed=3)[0].success


def test_state_is_threaded_through_each_trial():
    agent = Halver()
    records = evaluate(agent, CountdownEnv(), trials=2, seed=0)
    expected = [s for r in records for s in [None, *range(1, r.motions)]]
    assert agent.states == expected


def test_global_random_states_are_restored():
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002
    expected = random.random(), np.random.random()  # noqa: NPY002
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002
    evaluate(Halver(), CountdownEnv(), trials=2, seed=0)
    assert (random.random(), np.random.random()) == expected  # noqa: NPY002


def test_unknown_field_names_the_allowed_ones():
    (record,) = evaluate(Halver(), CountdownEnv(), trials=1, seed=0)
    with pytest.raises(KeyError, match="allowed: trial, motions"):
        record["speed"]


def test_without_the_truth_there_is_no_score():
    env = gym.make("CalFree/Reach-v0", truth=False)
    with pytest.raises(ValueError, match="make the environment with truth=True"):
        evaluate(agents.make("random", env), env, trials=1, seed=0)
