"""Learners of stable-baselines3 behind the surface of every agent."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

from agents.agent import Agent, Callback, Observation


class ScaledWords(gym.ActionWrapper[Any, Any, Any]):
    """A learner's action a in [-1, 1] becomes the word limit * sign(a) * |a|**curvature.

    Args:
        limit: The largest word. A fraction of the register makes small corrections learnable.
        curvature: Above 1, small words get finer.
    """

    def __init__(self, env: gym.Env[Any, Any], limit: float = 1.0, curvature: float = 1.0) -> None:
        super().__init__(env)
        if not 0 < limit <= 1 or curvature <= 0:
            raise ValueError(
                f"limit is {limit} and curvature is {curvature}; 0 < limit <= 1 and curvature > 0"
            )
        self.limit, self.curvature = limit, curvature

    def action(self, action: NDArray[Any]) -> NDArray[Any]:
        """Control words from a learner's action."""
        return np.asarray(self.limit * np.sign(action) * np.abs(action) ** self.curvature, np.float32)


class SacAgent(Agent):
    """Soft actor-critic (Haarnoja et al. 2018), from stable-baselines3.

    Args:
        env: The environment; its reward is what is learned from.
        seed: Of the networks and the exploration.
        word_limit, word_curvature: See `ScaledWords`.
        net_arch: Hidden layers of actor and critics.
        **settings: Of `stable_baselines3.SAC`.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        seed: int = 0,
        word_limit: float = 0.25,
        word_curvature: float = 1.0,
        net_arch: tuple[int, ...] = (128, 128),
        **settings: Any,
    ) -> None:
        super().__init__(env, seed)
        torch.set_num_threads(1)
        self._scaled = ScaledWords(env, word_limit, word_curvature)
        policy = {"net_arch": list(net_arch)}
        self._sac = SAC(
            "MultiInputPolicy",
            self._scaled,
            policy_kwargs=policy,
            seed=seed,
            device="cpu",
            **settings,
        )

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """See `Agent`."""
        actions, state = self._sac.predict(
            dict(observation), state, episode_start, deterministic=deterministic
        )
        return self._scaled.action(actions), state

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """See `Agent`."""
        self._sac._last_obs = None  # each call starts with a new trial
        self._sac.learn(
            total_timesteps,
            callback=_Translated(self, callback),
            reset_num_timesteps=self.num_timesteps == 0,
        )
        return self

    def save(self, path: str | Path) -> None:
        """See `Agent`."""
        self._sac.save(path)

    def load(self, path: str | Path) -> Self:
        """See `Agent`."""
        self._sac = SAC.load(path, env=self._scaled, device="cpu")
        self.num_timesteps = self._sac.num_timesteps
        return self


class _Translated(BaseCallback):
    """Keeps the agent's count of motions, and calls its callback after each."""

    def __init__(self, agent: Agent, callback: Callback | None) -> None:
        super().__init__()
        self._agent, self._callback = agent, callback

    def _on_step(self) -> bool:
        self._agent.num_timesteps = self.num_timesteps
        return self._callback is None or self._callback(self._agent)
