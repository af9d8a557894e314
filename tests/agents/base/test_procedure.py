"""What a procedure finds out in a trial, and who gets it."""

from itertools import islice

import numpy as np
import pytest

import agents
from agents.base.procedure import ProcedureAgent
from tests.agents.trials import motions_of


class Diary(ProcedureAgent):
    """Stands still, and finds out what it observes.

    Attributes:
        trials: What learn handed over: findings, last observation, and whether the trial had ended.
    """

    kind = "Diary"

    def __init__(self, env):
        super().__init__(env)
        self.trials = []

    def new_findings(self):
        return []

    def procedure(self, first, findings):
        findings.append(first)
        while True:
            findings.append((yield np.full(3, 0.01)))

    def learn_trial(self, findings, last, ended):
        self.trials.append((findings, last, ended))


def test_learn_hands_over_all_that_was_observed_in_whole_trials_and_nothing_of_one_cut_off(make_env):
    env = make_env(max_episode_steps=4, tolerance_px=1e-3)
    env.reset(seed=0)
    agent = Diary(env).learn(10)
    assert len(agent.trials) == 2  # and two motions of a third
    for findings, last, ended in agent.trials:
        assert not ended
        assert findings[-1] is last
        np.testing.assert_allclose([each.registers[0] for each in findings], 0.01 * np.arange(5), atol=1e-6)


def test_predict_hands_over_nothing(make_env):
    env = make_env(max_episode_steps=4, tolerance_px=1e-3)
    agent, state = Diary(env), None
    observation, _ = env.reset(seed=0)
    for _ in range(4):
        words, state = agent.predict(observation, state)
        observation, *_ = env.step(words)
    agent.predict(env.reset()[0], state, episode_start=np.array([True]))
    assert not agent.trials


def test_a_procedure_that_has_ended_sends_zero_words(make_env):
    class Once(Diary):
        def procedure(self, first, findings):
            yield np.full(3, 0.1)

    env = make_env(tolerance_px=1e-3)
    sent = [words for words, *_ in islice(motions_of(Once(env), env, seed=0), 3)]
    np.testing.assert_allclose(sent, [[0.1] * 3, [0.0] * 3, [0.0] * 3])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (None, "the observation is None; it must be a mapping of achieved_goal, desired_goal, obs"),
        ({"a": 1}, "the observation has a; it must have achieved_goal, desired_goal, observation"),
        ({"achieved_goal": np.full(4, np.nan)}, r"achieved_goal is \[nan.*must be finite"),
        ({"desired_goal": np.zeros(3)}, r"desired_goal has shape \(3,\); it must be \(4,\)"),
        ({"observation": np.zeros(8)}, r"shape \(8,\).*as in the environment that the agent"),
    ],
)
@pytest.mark.parametrize(
    "name", ["paper_servo", "memory", "random", "recurrent_servo", "sac", "recurrent_ppo"]
)
def test_what_is_no_observation_is_refused(make_env, name, change, said):
    env = make_env()
    observation, _ = env.reset(seed=0)
    wrong = observation | change if change and "a" not in change else change
    with pytest.raises(ValueError, match=said):
        agents.make(name, env).predict(wrong)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("paper_servo", "the state holds 5; pass"),
        ("recurrent_servo", "the state is 5; pass the state back"),
        ("recurrent_ppo", "the state is 5; pass the state back"),
    ],
)
def test_what_is_no_state_is_refused(make_env, name, said):
    env = make_env()
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match=said):
        agents.make(name, env).predict(observation, 5)


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("memory", {}, r"Memory \(.*, 3 motors\); pass the state back"),
        ("unified_servo", {"probe_px": 24.0}, ""),
    ],
)
def test_the_state_of_another_agent_is_refused(make_env, name, settings, said):
    env = make_env()
    observation, _ = env.reset(seed=0)
    _, state = agents.make(name, env, **settings).predict(observation)
    with pytest.raises(ValueError, match=f"the state holds a trial of {said}"):
        agents.make("unified_servo", env).predict(observation, state)


def test_rows_that_differ_are_refused(make_env):
    env = make_env()
    observation, _ = env.reset(seed=0)
    several = {key: np.stack([value] * 2) for key, value in observation.items()}
    several["observation"] = np.stack([observation["observation"]] * 3)
    with pytest.raises(ValueError, match="all keys must have as many"):
        agents.make("unified_servo", env).predict(several)
