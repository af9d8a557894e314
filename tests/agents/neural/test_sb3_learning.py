"""Learning of the adapter of stable-baselines3: motions counted, kept, and followed by updates."""

import random
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
import torch

from experiments.evaluation import evaluate
from tests.agents.neural.sb3_learners import make, rows_of_one_world, weights


@pytest.mark.parametrize("name", ["ppo", "recurrent_ppo"])
@pytest.mark.parametrize("rows", [1, 4])
def test_every_whole_rollout_teaches_however_motions_are_divided(name, rows):
    rollout = 20 * rows
    divided, at_once = (make(name, rows_of_one_world(rows)) for _ in range(2))
    for updates in (2, 4, 6):  # epochs
        before = weights(divided)
        divided.learn(rollout)
        assert not torch.equal(before, weights(divided))
        assert divided._model._n_updates == updates
    at_once.learn(3 * rollout)
    assert at_once._model._n_updates == 6
    assert divided.num_timesteps == at_once.num_timesteps == 3 * rollout
    before = weights(divided)
    divided.learn(rollout - 1)
    assert torch.equal(before, weights(divided))


@pytest.mark.parametrize("rows", [1, 4])
def test_off_policy_motions_in_parts_are_all_kept_and_teach(rows):
    settings = {"train_freq": 4, "learning_starts": 0, "gradient_steps": 2}
    agent = make("sac", rows_of_one_world(rows), **settings)
    for part in range(1, 21):
        agent.learn(4 * rows)
        assert agent._model.replay_buffer.pos == 4 * part
        assert agent._model._n_updates == 2 * part
    agent.learn(3 * rows)
    assert agent._model.replay_buffer.pos == 82
    assert agent._model._n_updates == 40


@pytest.mark.parametrize(
    ("name", "setting"), [("ppo", {}), ("recurrent_ppo", {}), ("sac", {"train_freq": 4}), ("sac", {})]
)
def test_any_number_of_motions_is_summed_over_rows_and_never_exceeded(name, setting):
    for rows in (1, 4):
        agent, seen, made = make(name, rows_of_one_world(rows), **setting), [], 0
        before = weights(agent)
        for asked in (4, 5, 19, 20, 21, 39, 41, 80):
            agent.learn(
                asked, callback=lambda progress, seen=seen: seen.append(progress.num_timesteps) or True
            )
            made += asked - asked % rows
            assert seen == list(range(rows, made + 1, rows))
            assert agent.num_timesteps == agent._model.num_timesteps == made
        assert not torch.equal(before, weights(agent))
    with pytest.raises(ValueError, match="got 3 motions; its 4 rows make 4 at once"):
        agent.learn(3)


def global_draws():
    return random.random(), np.random.random(), torch.rand(1).item()  # noqa: NPY002


def seeded(caller):
    random.seed(caller)
    np.random.seed(caller)  # noqa: NPY002
    torch.manual_seed(caller)


@pytest.mark.parametrize("name", ["sac", "ppo"])
def test_the_callers_generators_stay_and_learning_follows_from_the_seed_alone(name):
    learned = []
    for caller in (1, 2):
        seeded(caller)
        expected = global_draws()

        def untouched(make, caller=caller, expected=expected):
            seeded(caller)
            made = make()
            assert global_draws() == expected
            return made

        env = gym.make("CalFree/ReachDense-v0", dynamics="kinematic", world="nominal")
        env.reset(seed=5)
        agent = untouched(partial(make, name, env, seed=3))
        untouched(partial(agent.learn, 60))
        words, _ = untouched(partial(agent.predict, env.reset()[0], deterministic=False))
        learned.append((weights(agent).tolist(), words.tolist()))
    assert learned[0] == learned[1]


def test_networks_that_remember_learn_to_grasp_and_are_evaluated():
    env = gym.make("CalFree/GraspDense-v0", max_episode_steps=6)
    agent = make("recurrent_ppo", env).learn(40)
    assert len(evaluate(agent, env, 2, seed=3)) == 2


def test_no_motions_change_nothing():
    agent = make()
    before = weights(agent)
    assert agent.learn(0).num_timesteps == 0
    assert torch.equal(weights(agent), before)


def test_rewards_of_several_motions_are_of_one_trial():
    agent = make(n_steps=3, gamma=0.5, learning_starts=100)
    agent.learn(6).learn(6)
    buffer = agent._model.replay_buffer
    assert buffer._get_samples(np.array([5])).rewards.item() == buffer.rewards[5].item()
