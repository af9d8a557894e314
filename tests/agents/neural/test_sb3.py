"""The adapter of stable-baselines3: algorithms by name, networks' inputs, rows."""

import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

import agents
from agents.neural import TUNED
from agents.neural.sb3.sb3_agent import ImageDistance, flattened
from tests.agents.neural.sb3_learners import make

CONFIGS = Path(__file__).parents[3] / "configs" / "agents"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"algorithm": "sb3_contrib.CrosQ"}, r"'sb3_contrib.CrosQ' \(did you mean sb3_contrib.CrossQ.*allow"),
        ({"algorithm": "stable_baselines.SAC"}, r"mean stable_baselines3.SAC.*allowed: .*sb3_contrib.TQC"),
        ({"algorithm": "os.system"}, r"algorithm is 'os.system'; allowed: stable_baselines3.A2C"),
        ({"algorithm": "sb3_contrib.TQC", "n_epochs": 3}, "no setting 'n_epochs'.*top_quantiles_to_drop"),
        ({"algorithm": "stable_baselines3.DQN"}, "only supports .*Discrete"),
        ({"replay_buffer_class": "HerReplayBufer"}, "did you mean HerReplayBuffer"),
        ({"policy_kwargs": {"activation_fn": "Silu"}}, "activation_fn is 'Silu'.*allowed: .*SiLU"),
        ({"action_noise": -1}, "action_noise is -1"),
        ({"distance_scales": [0]}, "distance_scales is 0"),
        ({"distance_scales": 3}, "distance_scales is 3; it must be a list of numbers"),
        ({"net_arch": "abc"}, "net_arch is 'abc'; it must be a list of numbers"),
        ({"net_arch": [0]}, "net_arch is 0; it must be a whole number, 1 or more"),
        ({"word_limit": "a"}, "word_limit is 'a'; it must be a number, above 0, at most 1"),
        ({"word_curvature": float("inf")}, "word_curvature is inf; it must be a finite number"),
        ({"policy_kwargs": 3}, "policy_kwargs is 3; it must be a mapping"),
        ({"gamma": "x"}, "gamma is 'x'; it must be a number, 0 or more, at most 1"),
        ({"gamma": 5}, "gamma is 5"),
        ({"learning_rate": 0}, "learning_rate is 0; it must be a number, above 0"),
        ({"learning_rate": "3e-4"}, "learning_rate is '3e-4'"),
        ({"batch_size": 0}, "batch_size is 0; it must be a whole number, 1 or more"),
        ({"buffer_size": 0}, "buffer_size is 0"),
        ({"gradient_steps": -2}, "gradient_steps is -2; it must be a whole number, -1 or more"),
        ({"learning_starts": -1}, "learning_starts is -1"),
        ({"train_freq": 0}, "train_freq is 0"),
        ({"train_freq": [1, "trial"]}, "unit of train_freq is 'trial'.*allowed: step, episode"),
        ({"algorithm": "stable_baselines3.PPO", "n_steps": 0}, "n_steps is 0"),
        ({"rows": 0}, "rows is 0"),
        ({"algorithm": "sb3_contrib.CrossQ", "replay_buffer_class": "HerReplayBuffer"}, "tions by key"),
    ],
    ids=str,
)
def test_wrong_settings_say_what_is_allowed(settings, message):
    env = gym.make("CalFree/ReachDense-v0")
    with pytest.raises(ValueError, match=message):
        agents.make("sb3", env, **settings)


@pytest.mark.parametrize("name", TUNED)
def test_a_name_is_its_file_and_settings_given_override_it(name):
    tuned = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    by_name = make(name)._model
    assert f"{type(by_name).__module__.split('.')[0]}.{type(by_name).__name__}" == tuned["algorithm"]
    assert by_name.gamma == tuned["gamma"]
    assert make(name, gamma=0.123)._model.gamma == 0.123


def test_networks_get_the_image_distance():
    observation = gym.make("CalFree/Reach-v0").reset(seed=0)[0]
    space = gym.make("CalFree/Reach-v0").observation_space
    d = observation["achieved_goal"] - observation["desired_goal"]
    flat = torch.as_tensor(flattened(observation))[None]
    by_key = {key: torch.as_tensor(value)[None] for key, value in observation.items()}
    extractor = ImageDistance(space, 4, (1, 8))
    for features in (extractor(flat), extractor(by_key)):
        assert features.shape == (1, extractor.features_dim)
        np.testing.assert_allclose(features[0, :15], gym.spaces.flatten(space, observation))
        np.testing.assert_allclose(features[0, 15:], np.tanh([*d, *(8 * d)]), atol=1e-6)


def test_hindsight_relabels_with_places_that_the_gripper_came_to():
    with pytest.warns(UserWarning, match="hindsight relabelling is not valid on the waist mount"):
        make("sac_her", gym.make("CalFree/Reach-v0", camera_mount="waist"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make("sac_her", gym.make("CalFree/Grasp-v0"))
    agent = make("sac_her").learn(130)
    sample = agent._model.replay_buffer.sample(60)
    reached = agent._model.replay_buffer.next_observations["achieved_goal"][:130, 0]
    goals = sample.observations["desired_goal"].numpy()
    assert sum((goal == reached).all(1).any() for goal in goals) > 20
