"""The network against PyTorch's."""

import numpy as np
import pytest
import torch
from torch import nn

from agents.neural.self_supervised.inverse_model import Perceptron

WIDTHS = (15, 64, 32, 12)


@pytest.fixture
def network():
    return Perceptron(WIDTHS, learning_rate=3e-3, seed=0)


@pytest.fixture
def theirs(network):
    """PyTorch's, with the same weights."""
    made = nn.Sequential(
        nn.Linear(15, 64), nn.SiLU(), nn.Linear(64, 32), nn.SiLU(), nn.Linear(32, 12)
    ).double()
    nn.utils.vector_to_parameters(torch.from_numpy(network.weights).double(), made.parameters())
    return made


def test_steps_are_those_of_pytorch(network, theirs):
    """Losses with a gradient that depends on the outputs: after each step all weights are the same."""
    rng = np.random.default_rng(1)
    adam = torch.optim.Adam(theirs.parameters(), lr=3e-3)
    averaged = network.weights.astype(float)
    for _ in range(50):
        inputs, wanted = np.float32(rng.normal(size=(20, 15))), np.float32(rng.normal(size=(20, 12)))
        passed = network.forward(inputs)
        outputs = theirs(torch.from_numpy(inputs).double())
        np.testing.assert_allclose(passed.outputs, outputs.detach(), atol=1e-4)
        network.descend(passed, (passed.outputs - wanted) ** 3)
        adam.zero_grad()
        ((outputs - torch.from_numpy(wanted).double()) ** 4 / 4).sum().backward()
        adam.step()
        latest = nn.utils.parameters_to_vector(theirs.parameters()).detach().numpy()
        averaged += 0.01 * (latest - averaged)
    np.testing.assert_allclose(network.weights, latest, atol=2e-4)
    np.testing.assert_allclose(network.averaged, averaged, atol=2e-4)


def test_the_averaged_weights_act(network):
    inputs = np.float32(np.random.default_rng(1).normal(size=(5, 15)))
    first = network(inputs)
    np.testing.assert_array_equal(first, network.forward(inputs).outputs)
    for _ in range(20):
        network.descend(network.forward(inputs), np.ones((5, 12), np.float32))
    assert (network.forward(inputs).outputs < network(inputs)).all()
    assert (network(inputs) < first).all()


def test_first_weights_are_spread_as_in_pytorch():
    """Uniform within 1 / √(inputs), matrix and bias."""
    weights = Perceptron((100, 400, 3), learning_rate=1e-3, seed=3).weights
    first, second = np.split(weights, [101 * 400])
    assert np.abs(first).max() == pytest.approx(1 / 10, rel=1e-3)
    assert first.std() == pytest.approx(1 / 10 / np.sqrt(3), rel=0.02)
    assert np.abs(second).max() == pytest.approx(1 / 20, rel=1e-2)
