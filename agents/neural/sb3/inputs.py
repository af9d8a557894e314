"""What a network gets: an observation as one array, and in it the image distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.spaces import flatten_space
from numpy.typing import NDArray
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

GOALS = ("achieved_goal", "desired_goal")


def flattened(observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
    """All arrays (..., n) of an observation side by side, by the order of their keys' names."""
    return np.concatenate([observation[key] for key in sorted(observation)], axis=-1)


class FlatObservations(VecEnvWrapper):
    """A `VecEnv` with observations as one array: what all algorithms take, and replay buffers sample fast."""

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv, flatten_space(venv.observation_space))

    def reset(self) -> NDArray[np.float32]:
        """Begins a trial in every row."""
        return flattened(self.venv.reset())  # type: ignore[arg-type]

    def step_wait(self) -> Any:
        """Executes one motion in every row."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for row in np.flatnonzero(dones):
            infos[row]["terminal_observation"] = flattened(infos[row]["terminal_observation"])
        return flattened(observations), rewards, dones, infos  # type: ignore[arg-type]


class ImageDistance(BaseFeaturesExtractor):
    """Adds tanh(s d) to a network's inputs, d the image distance, for each of some scales s.

    A network that gets gripper and object points apart must first learn to subtract. A rendezvous is 1/64 of
    an image unit: with a large s, small distances fill the range of the input.

    Args:
        space: Of flat observations, or a goal environment's `Dict`.
        goals: Numbers in each goal; flat observations begin with both.
        scales: s.
    """

    def __init__(self, space: gym.Space[Any], goals: int, scales: Sequence[float]) -> None:
        inputs = int(np.prod(flatten_space(space).shape or ()))
        super().__init__(space, inputs + goals * len(scales))
        self._goals = goals
        self._scales = tuple(scales)

    def forward(self, observations: torch.Tensor | dict[str, torch.Tensor]) -> torch.Tensor:
        """Features (n, features) from observations (n, ...)."""
        if isinstance(observations, dict):
            observations = torch.cat([observations[key] for key in sorted(observations)], 1)
        goals = self._goals
        distance = observations[:, :goals] - observations[:, goals : 2 * goals]
        return torch.cat([observations, *(torch.tanh(scale * distance) for scale in self._scales)], 1)
