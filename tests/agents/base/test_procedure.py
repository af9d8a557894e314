"""What a procedure finds out in a trial, and who gets it."""

from contextlib import nullcontext
from functools import partial
from itertools import islice

import numpy as np
import pytest

import agents
from agents.base.procedure import ProcedureAgent
from tests.agents.trials import motions_of

GOALS = ("achieved_goal", "desired_goal")


class Diary(ProcedureAgent):
    """Stands still, and finds out what it observes."""

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


@pytest.mark.parametrize("own", [(), ("arrays",), ("restore",), ("arrays", "restore")])
def test_an_agent_that_learns_is_not_saved_without_what_it_has_learned(make_env, tmp_path, own):
    methods = {"arrays": lambda self: {}, "restore": lambda self, arrays: None}
    agent = type("Learner", (Diary,), {name: methods[name] for name in own})(make_env())
    refused = pytest.raises(TypeError, match="Learner learns, but has no arrays and restore of its own")
    with refused if len(own) < 2 else nullcontext():
        agent.save(tmp_path / "learner.npz")
    assert (tmp_path / "learner.npz").exists() == (len(own) == 2)


def test_words_that_are_too_few_are_told_by_the_class_that_sends_them(make_env):
    class Brief(Diary):
        def procedure(self, first, findings):
            yield [0.0, 0.0]

    env = make_env()
    with pytest.raises(ValueError, match=r"Brief.procedure yields array\(\[0., 0.\]\); it must be 3 words"):
        Brief(env).predict(env.reset(seed=0)[0])


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
        ({**dict.fromkeys(GOALS, np.zeros((2, 4))), "observation": np.zeros((3, 7))}, "must have as many"),
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


def of_another(name, env, observation, **settings):
    return agents.make(name, env, **settings).predict(observation)[1]


@pytest.mark.parametrize(
    ("name", "state", "said"),
    [
        ("paper_servo", lambda *_: 5, "the state holds 5; pass"),
        ("recurrent_servo", lambda *_: 5, "the state is 5; pass the state back"),
        ("recurrent_ppo", lambda *_: 5, "the state is 5; pass the state back"),
        ("unified_servo", partial(of_another, "memory"), r"trial of Memory \(.*, 3 motors\); pass the state"),
        ("unified_servo", partial(of_another, "unified_servo", probe_px=24.0), "holds a trial of "),
    ],
)
def test_what_is_no_state_of_its_own_is_refused(make_env, name, state, said):
    env = make_env()
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match=said):
        agents.make(name, env).predict(observation, state(env, observation))
