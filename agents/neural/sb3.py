"""Learners of stable-baselines3 behind the surface of every agent."""

from __future__ import annotations

import json
from inspect import signature
from pathlib import Path
from typing import Any, Self
from zipfile import ZipFile

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger

from agents.base.agent import Agent, Callback
from agents.base.observation import RawObservation

_WORDS = "calfree.json"
_OURS = ("policy", "env", "policy_kwargs", "device", "_init_setup_model")


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
        self._adopt(
            SAC("MultiInputPolicy", self._scaled, policy_kwargs=policy, seed=seed, device="cpu", **settings)
        )

    def _adopt(self, sac: SAC) -> None:
        """Takes over a learner, without the seed that it would draw a world from and without its logs."""
        self._sac = sac
        self._sac.get_env()._reset_seeds()  # type: ignore[union-attr]
        self._sac.set_logger(Logger(folder=None, output_formats=[]))

    def predict(
        self,
        observation: RawObservation,
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
        """See `Agent`. The replay buffer is left out: learning goes on as from new, with trained networks."""
        with Path(path).open("wb") as file:
            self._sac.save(file)
        with ZipFile(path, "a") as archive:
            archive.writestr(_WORDS, json.dumps(self._words()))

    def load(self, path: str | Path) -> Self:
        """See `Agent`.

        Raises:
            ValueError: The file is damaged, no saved agent, or of one that scaled its words otherwise.
        """
        try:
            with ZipFile(path) as archive:
                saved = json.loads(archive.read(_WORDS))
            sac = SAC.load(path, env=self._scaled, device="cpu")
        except FileNotFoundError:
            raise
        except Exception as error:  # what is raised on a damaged file depends on where the damage is
            raise ValueError(f"{path} is damaged or no saved sac: {error!r}") from error
        if saved != self._words():
            raise ValueError(f"{path} holds a sac with {saved}; this one has {self._words()}")
        warm_up = sac.learning_starts
        self._adopt(sac)
        self.num_timesteps = sac.num_timesteps
        self._sac.learning_starts = self.num_timesteps + warm_up
        return self

    def _words(self) -> dict[str, float]:
        return {"word_limit": self._scaled.limit, "word_curvature": self._scaled.curvature}


class _Translated(BaseCallback):
    """Keeps the agent's count of motions, and calls its callback after each."""

    def __init__(self, agent: Agent, callback: Callback | None) -> None:
        super().__init__()
        self._agent, self._callback = agent, callback

    def _on_step(self) -> bool:
        self._agent.num_timesteps = self.num_timesteps
        return self._callback is None or self._callback(self._agent)


SETTINGS = tuple(
    dict.fromkeys(
        name
        for of in (SacAgent, SAC)
        for name, parameter in signature(of).parameters.items()
        if parameter.kind is not parameter.VAR_KEYWORD and name not in _OURS
    )
)
"""What `SacAgent` takes beside the environment: its own settings and those of stable-baselines3's SAC."""
