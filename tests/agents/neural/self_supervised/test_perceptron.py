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
