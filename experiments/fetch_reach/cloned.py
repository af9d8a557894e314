"""A network that was shown the way with cameras as built, and what it was shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from calfree_gym.geometry import Array
from experiments.fetch_reach.environment import GRIPPER, REACH, fetch, points_of

DEMONSTRATED = 150
"""Episodes."""
FIRST_DEMONSTRATION = 10_000
"""Seed of the first one; those of the episodes that count are below."""
EXPLORED = 0.3
"""Standard deviation of what leads demonstrations astray, so that ways back are shown, too (choice)."""


def demonstrations(env: gym.Env[Any, Any], seed: int) -> tuple[list[Any], Array]:
    """What is observed (n), and the words (n, 3) that lead to the goal from there."""
    rng = np.random.default_rng(seed)
    observed, shown = [], []
    for episode in range(DEMONSTRATED):
        observation, _ = env.reset(seed=FIRST_DEMONSTRATION + episode)
        over = False
        while not over:
            made: Any = env.unwrapped
            words = (made.goal - made.data.site(GRIPPER).xpos) / REACH
            observed.append(observation)
            shown.append(words)
            observation, _, terminated, truncated, _ = env.step(words + rng.normal(0, EXPLORED, 3))
            over = terminated or truncated
    env.close()
    return observed, np.array(shown)


class Cloned:
    """A network that was shown which way to go from what both images and the registers tell, as built."""

    UNITS, EPOCHS = 64, 2000
    """Choice: the training error no longer falls."""

    def __init__(self, seed: int = 1) -> None:
        import torch

        observations, shown = demonstrations(points_of(fetch()), seed)
        seen = np.array([_flat(each) for each in observations])
        torch.manual_seed(seed)
        units = self.UNITS
        self._net = torch.nn.Sequential(
            *(torch.nn.Linear(seen.shape[1], units), torch.nn.Tanh()),
            *(torch.nn.Linear(units, units), torch.nn.Tanh(), torch.nn.Linear(units, 3)),
        )
        inputs, targets = (torch.as_tensor(each, dtype=torch.float32) for each in (seen, shown))
        optimizer = torch.optim.Adam(self._net.parameters(), lr=3e-3)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.EPOCHS)
        for _ in range(self.EPOCHS):
            optimizer.zero_grad()
            torch.nn.functional.mse_loss(self._net(inputs), targets).backward()
            optimizer.step()
            schedule.step()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) as they would have been shown."""
        import torch

        with torch.no_grad():
            words = self._net(torch.as_tensor(_flat(observation), dtype=torch.float32))
        return np.clip(words.numpy(), -1, 1)


def _flat(observation: Mapping[str, Array]) -> Array:
    return np.concatenate([observation[key] for key in ("achieved_goal", "desired_goal", "observation")])
