"""in_context: what outlasts a trial, its regression of places, and what a life of trials brings."""

import numpy as np
import pytest
import torch

import agents
from agents.neural.recurrent_servo.network import KEPT
from agents.neural.recurrent_servo.places import PlaceRegression
from tests.agents.trials import STAND_FIRST

UNSEEN = 1000  # seed of the first test world; those of training are 100,000 and more


@pytest.mark.parametrize("mount", STAND_FIRST)
def test_it_needs_fewer_motions_in_later_trials(live, make_env, mount):
    first, later = [], []
    for seed in range(UNSEEN, UNSEEN + 4):
        _, lengths = live("in_context", make_env(mount), seed, trials=12)
        first.append(lengths[0])
        later += lengths[6:]
    assert np.mean(later) < 0.5 * np.mean(first)


def test_memory_outlasts_trials_and_loads_and_a_new_life_begins_without(make_env, tmp_path):
    env = make_env()
    observation, _ = env.reset(seed=UNSEEN)
    agent = agents.make("in_context", env)
    untaught, _ = agent.predict(observation)
    agent.learn(20)
    weights = {name: tensor.clone() for name, tensor in agent._network.state_dict().items()}
    taught, _ = agent.predict(observation)
    agent.save(tmp_path / "life")
    again = agents.make("in_context", env).load(tmp_path / "life")
    assert not np.allclose(taught, untaught, atol=0.01)
    np.testing.assert_array_equal(again.predict(observation)[0], taught)
    np.testing.assert_array_equal(agents.make("in_context", env).predict(observation)[0], untaught)
    assert all(torch.equal(tensor, weights[name]) for name, tensor in agent._network.state_dict().items())


def test_networks_of_the_other_agent_are_refused(make_env):
    for mine, other in (("in_context", "recurrent_servo"), ("recurrent_servo", "in_context")):
        with pytest.raises(ValueError, match=f"holds {other}; this agent is {mine}"):
            agents.make(mine, make_env(), weights=str(KEPT[other]))


def test_the_regression_of_places_is_bayesian():
    rng = np.random.default_rng(0)
    features, registers = rng.standard_normal((6, 4)), rng.standard_normal((6, 3))
    variances = rng.uniform(0.1, 1, 6)
    places = PlaceRegression(
        torch.zeros(1, 3, 4).double(), torch.eye(4).double()[None], torch.zeros(1, 4).double()
    )
    for told, where, variance in zip(features, registers, variances, strict=True):
        places = places._replace(features=torch.tensor(told)[None])
        places = places.told(torch.tensor(where)[None], torch.tensor([variance]))
    precision = np.eye(4) + (features.T / variances) @ features
    np.testing.assert_allclose(places.covariance[0], np.linalg.inv(precision), atol=1e-12)
    means = np.linalg.solve(precision, (features.T / variances) @ registers)
    np.testing.assert_allclose(places.weights[0], means.T, atol=1e-12)
    view = features[-1]
    assert places.variance.item() == pytest.approx(view @ np.linalg.solve(precision, view))
    forgotten = places.forgotten(torch.ones(1))
    torch.testing.assert_close(forgotten.covariance[0], torch.eye(4).double())
    assert not forgotten.weights.any()
