"""Agents that teach themselves, in linear worlds where every answer is known."""

import numpy as np
import pytest
import torch
from torch import nn

import agents
from agents.base import storage
from agents.neural.self_supervised.inverse_model import Perceptron
from agents.neural.self_supervised.self_taught import LearnedReach
from tests.agents.neural.self_supervised.conftest import QUICK, LinearWorld
from tests.agents.trials import assert_same_arrays, motions_of


def lengths(agent, env, trials=20):
    """Motions of some trials without learning; 30 where it did not arrive."""
    return np.array([len(list(motions_of(agent, env))) for _ in range(trials)])


@pytest.mark.parametrize("motors", [2, 3, 6])
def test_it_learns_to_reach_with_any_number_of_motors(linear, motors):
    agent, env = linear(motors=motors, settings={})
    assert lengths(agent, env).mean() < 4


def test_the_plain_form_learns_to_reach(linear):
    settings = {"hidden": (32,), "random_motions": 150, "learning_rate": 3e-3}
    agent, env = linear("cooperstock_milios", motions=400, settings=settings, tolerance=0.1)
    assert np.median(lengths(agent, env)) < 10


def test_the_unit_of_image_points_changes_nothing(linear):
    settings = {**QUICK, "patience": 100}  # random words in a trial follow from its object's numbers
    (one, env), (half, small) = (linear(motions=120, settings=settings, unit=unit) for unit in (1, 0.5))
    observation, _ = env.reset()
    again, _ = small.reset()
    np.testing.assert_array_equal(one.predict(observation)[0], half.predict(again)[0])


def test_a_reversed_motor_is_told_and_the_replay_mended(linear):
    agent, env = linear(motions=250)
    env.signs[1] = -1
    agent.learn(60)
    assert [change[1].tolist() for change in agent.changes] == [[1, -1, 1]]
    assert 250 < agent.changes[0][0] <= 290
    pairs = agent.replay.sample(2000, np.random.default_rng(0))
    true = np.isclose(pairs.change, pairs.words * env.signs @ env.jacobian.T, atol=1e-5).all(1)
    assert true.mean() > 0.98  # it dates the change to a motion or two
    assert lengths(agent, env).mean() < 4


def test_what_a_trial_showed_of_the_network_does_not_correct_the_one_that_was_mended(linear, monkeypatch):
    agent, env = linear(motions=250)
    corrections, reverse = [], agent.model.reverse
    monkeypatch.setattr(agent, "new_findings", lambda: corrections.append(LearnedReach()) or corrections[-1])
    monkeypatch.setattr(
        agent.model, "reverse", lambda signs: found.extend(corrections[-1:]) or reverse(signs)
    )
    found = []
    env.signs[1] = -1
    agent.learn(60, callback=lambda progress: not found)
    assert found
    assert not found[0].changes
    assert not found[0].residuals


def test_another_change_is_told_and_the_replay_doubted(linear):
    agent, env = linear(motions=300, settings={"hidden": (32,), "updates": 2})
    env.jacobian = env.jacobian[[2, 3, 0, 1]]  # cameras have changed places
    agent.learn(150)
    assert [signs for _, signs in agent.changes if signs is not None] == []
    assert len(agent.changes) == 1
    assert agent.replay.sample(100, np.random.default_rng(0)).doubtful.any()
    assert lengths(agent, env).mean() < 4


@pytest.mark.parametrize(("noise", "outliers"), [(0.0, 0.0), (0.012, 0.0), (0.002, 0.1)])
def test_noise_is_no_change(linear, noise, outliers):
    agent, _ = linear(motions=400, noise=noise, outliers=outliers, tolerance=0.06, settings={})
    assert agent.changes == []


@pytest.mark.parametrize("name", ["self_supervised", "cooperstock_milios"])
def test_a_loaded_agent_learns_on_as_the_saved_one(linear, name, tmp_path):
    settings = {**QUICK, "random_motions": 20}
    agent, _ = linear(name, motions=80, settings=settings)
    agent.save(tmp_path / "agent.npz")
    again, other = (
        agents.make(name, LinearWorld(), seed=seed, **settings).load(tmp_path / "agent.npz")
        for seed in (0, 7)
    )
    assert_same_arrays(other, agent)
    assert other.learn(5).num_timesteps == 85
    for each in (agent, again):
        each.env.rng = np.random.default_rng(5)
        each.learn(30)
    assert_same_arrays(again, agent)


def test_a_trial_that_is_cut_off_teaches_what_was_seen_and_no_more(linear):
    agent, env = linear(motions=45)
    for _ in range(10):
        agent.learn(3)
    pairs = agent.replay.sample(2000, np.random.default_rng(0))
    np.testing.assert_allclose(pairs.change, pairs.words @ env.jacobian.T, atol=1e-6)


def test_a_file_of_other_settings_or_damaged_is_refused(linear, tmp_path):
    agent, env = linear(motions=60)
    path = tmp_path / "agent.npz"
    agent.save(path)
    with pytest.raises(ValueError, match=r"hidden=\(16,\).*hidden=\(8,\)"):
        agents.make("self_supervised", env, hidden=(8,)).load(path)
    with pytest.raises(ValueError, match=r"3 motors.*4 motors"):
        agents.make("self_supervised", LinearWorld(motors=4), **QUICK).load(path)
    arrays = agent.arrays()
    for name, bad, said in (
        ("model/averaged", arrays["model/averaged"] * np.nan, "averaged"),
        ("replay/trials", arrays["replay/trials"][::-1], "do not ascend"),
        ("replay/doubtful", np.array(99), "99 of"),
    ):
        storage.save(path, agent.kind, {**arrays, name: bad}, 60, 3)
        with pytest.raises(ValueError, match=f"damaged: .*{said}"):
            agent.load(path)


def test_it_reaches_in_a_wild_world(make_env):
    env = make_env(world="wild", truth=False)
    env.reset(seed=50_000)
    agent = agents.make("self_supervised", env).learn(120)
    assert np.mean([list(motions_of(agent, env))[-1][2] for _ in range(10)]) > 0.8


def test_it_gets_back_into_view():
    env = LinearWorld()
    agent = agents.make("self_supervised", env, **QUICK).learn(60)
    observation, _ = env.reset()
    words, state = agent.predict(observation)
    observation, *_ = env.step(words)
    observation["observation"][0] = 0.0
    back, state = agent.predict(observation, state)
    np.testing.assert_allclose(back, -observation["observation"][4:] / 2, rtol=1e-6)


WIDTHS = (15, 64, 32, 12)


@pytest.fixture
def perceptron():
    return Perceptron(WIDTHS, learning_rate=3e-3, seed=0)


@pytest.fixture
def theirs(perceptron):
    """PyTorch's, with the same weights."""
    made = nn.Sequential(
        nn.Linear(15, 64), nn.SiLU(), nn.Linear(64, 32), nn.SiLU(), nn.Linear(32, 12)
    ).double()
    nn.utils.vector_to_parameters(torch.from_numpy(perceptron.weights).double(), made.parameters())
    return made


def test_steps_are_those_of_pytorch(perceptron, theirs):
    rng = np.random.default_rng(1)
    adam = torch.optim.Adam(theirs.parameters(), lr=3e-3)
    averaged = perceptron.weights.astype(float)
    for _ in range(50):
        inputs, wanted = np.float32(rng.normal(size=(20, 15))), np.float32(rng.normal(size=(20, 12)))
        passed = perceptron.forward(inputs)
        outputs = theirs(torch.from_numpy(inputs).double())
        np.testing.assert_allclose(passed.outputs, outputs.detach(), atol=1e-4)
        perceptron.descend(passed, (passed.outputs - wanted) ** 3)
        adam.zero_grad()
        ((outputs - torch.from_numpy(wanted).double()) ** 4 / 4).sum().backward()
        adam.step()
        latest = nn.utils.parameters_to_vector(theirs.parameters()).detach().numpy()
        averaged += 0.01 * (latest - averaged)
    np.testing.assert_allclose(perceptron.weights, latest, atol=2e-4)
    np.testing.assert_allclose(perceptron.averaged, averaged, atol=2e-4)
