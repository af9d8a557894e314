import random
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import agents
from experiments.evaluation import LOOK_SECONDS, evaluate, robot_seconds_at
from tests.arms.own import ARMS
from tests.experiments.fakes import CountdownEnv, Halver


def test_records_tell_what_happened():
    env = CountdownEnv()
    records = evaluate(Halver(), env, trials=5, seed=7)
    starts = np.random.default_rng(7).uniform(20, 200, 5)
    for trial, (record, start) in enumerate(zip(records, starts, strict=True)):
        motions = int(np.ceil(np.log2(start / 4)))
        assert (record.trial, record.motions, record.success) == (trial, motions, True)
        assert record.robot_seconds == pytest.approx(1.5 * motions + 2.5)
        assert record.rendezvous
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
    assert not record.rendezvous
    assert record.motions_to == {2: None, 4: None, 8: None, 16: None}


@pytest.mark.parametrize("noise_px", [0.5, 20.0])
def test_success_is_the_truth_within_the_tolerance_and_a_rendezvous_what_is_observed(noise_px):
    """With 20 px of noise most observed rendezvous are none, and the threshold does not grow with it."""
    asked = {"dynamics": "kinematic", "tolerance_px": 16.0, "tell": ("object_registers",)}
    env = gym.make("CalFree/Reach-v0", **asked)
    env.reset(seed=0)
    env = gym.make("CalFree/Reach-v0", world=replace(env.unwrapped.world, point_noise=noise_px), **asked)
    records = evaluate(Shaky(), env, trials=60, seed=0)
    assert all(record.success == (record.error_px <= 16.0) for record in records)
    assert all(record.rendezvous == (record.motions < 60) for record in records)
    true = np.mean([record.success for record in records if record.rendezvous])
    assert true >= 0.95 if noise_px < 1 else true < 0.9


def test_robot_seconds_at_another_look_time_count_the_way_home():
    env = gym.make("CalFree/Reach-v0", world="nominal", dynamics="kinematic")
    (record,) = evaluate(agents.make("paper_servo", env), env, trials=1, seed=0)
    looks = record.motions + 1
    moving = record.robot_seconds - looks * LOOK_SECONDS
    assert moving > 0
    np.testing.assert_allclose(
        robot_seconds_at(np.array([0.2, 4.0]), record.robot_seconds, record.motions),
        [moving + 0.2 * looks, record.robot_seconds],
    )


class Shaky:
    """Goes to the object, and off by some pixels."""

    def __init__(self):
        self._rng = np.random.default_rng(0)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        target = observation["object_registers"] + self._rng.normal(0, 0.02, 3)
        return target - observation["observation"][4:], None


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


def test_what_an_agent_expects_is_asked_before_it_moves():
    class Expecting(Halver):
        def expected_px(self, first):
            return 7.0 + len(first)

    env = CountdownEnv()
    first, _ = env.reset(seed=7)
    assert [r.expected_px for r in evaluate(Expecting(), env, 3, 7)] == [7.0 + len(first)] * 3
    assert evaluate(Halver(), env, 1, 7)[0].expected_px is None


@pytest.mark.parametrize(
    ("env", "trials", "said"),
    [
        (lambda: CountdownEnv(), 1.5, "trials is 1.5; it must be a whole number, 0 or more"),
        (lambda: gym.make_vec("CalFree/Reach-v0", num_envs=3), 1, "in one environment; this is a batch of 3"),
        (lambda: gym.make("CalFree/Reach-v0", truth=False), 1, "make the environment with truth=True"),
    ],
)
def test_where_there_is_no_score_it_is_said(env, trials, said):
    with pytest.raises(ValueError, match=said):
        evaluate(Halver(), env(), trials, seed=0)


@pytest.mark.parametrize(
    ("name", "other", "said"),
    [
        ("memory", {"arm": ARMS["scara"]}, r"action is \(4,\), not \(3,\), observation is \(8,\), not"),
        ("random", {"id": "CalFree/Grasp-v0"}, r"achieved_goal is \(5,\), not \(4,\)"),
        ("memory", {"observation": "pixels"}, r"achieved_goal is None, not \(4,\)"),
        ("oracle", {}, r"object_registers is None, not \(3,\)$"),
    ],
)
def test_an_agent_of_another_arm_or_task_is_told_what_differs(name, other, said):
    agent = agents.make(name, gym.make("CalFree/Reach-v0", tell=("object_registers",)))
    with pytest.raises(
        ValueError, match=f"was made for an environment of other shapes; in this one .*{said}"
    ):
        evaluate(agent, gym.make(**{"id": "CalFree/Reach-v0", **other}), trials=1, seed=0)


def test_an_agent_that_learned_in_a_batch_is_evaluated_in_one_environment():
    same_step = {"dynamics": "kinematic", "autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
    agent = agents.make("sac", gym.make_vec("CalFree/Reach-v0", num_envs=2, **same_step))
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic", max_episode_steps=3)
    assert len(evaluate(agent, env, trials=1, seed=0)) == 1


def test_a_trial_begins_whatever_the_registers_tell_after_a_short_one():
    noise = {"at": {"trial": 0}, "do": {"type": "register_noise", "registers": 0.02}}
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic", max_episode_steps=1, perturbations=[noise])
    assert len(evaluate(agents.make("paper_servo", env), env, 100, seed=0)) == 100


def test_who_keeps_no_state_is_told_once_that_a_trial_begins():
    class Notes:
        def __init__(self):
            self.begun = []

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            self.begun += episode_start.tolist()
            return np.zeros(3), None

    agent = Notes()
    evaluate(agent, gym.make("CalFree/Reach-v0", dynamics="kinematic", max_episode_steps=3), 2, seed=0)
    assert agent.begun == [True, False, False] * 2
