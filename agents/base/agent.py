"""The one surface that every agent has: that of a stable-baselines3 algorithm, without needing it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .checks import check_number
from .observation import RawObservation
from .prior_knowledge import PriorKnowledge
from .registration import Settings, named_settings
from .storage import AgentFile
from .trials import TrialBeginnings


class Progress(Protocol):
    """What a callback of `learn` gets."""

    num_timesteps: int


Callback = Callable[[Progress], bool]
"""Called after every motion; returning False ends `learn`."""


class Agent(ABC):
    """A controller of the black box.

    Attributes:
        privileged: What it requires beyond the standard observations, by the names of `tell=`; mostly empty.
        prior_knowledge: What it is built on beyond its observations; every table prints it.
        rows: How many arms, all in one world, it learns from at once where it can.
        num_timesteps: Motions that it has made in `learn`, over its whole life.

    Args:
        env: The environment that it learns in, and whose spaces it acts in.
        seed: Of all that it draws.

    Raises:
        ValueError: The environment does not tell what it requires, or the seed is none.
    """

    privileged: ClassVar[tuple[str, ...]] = ()
    prior_knowledge: frozenset[PriorKnowledge] = frozenset()
    rows: int = 1

    def __init__(self, env: gym.Env[Any, Any], seed: int = 0) -> None:
        spaces: Mapping[str, Any] = getattr(env.observation_space, "spaces", {})
        if missing := [name for name in self.privileged if name not in spaces]:
            raise ValueError(
                f"it requires {', '.join(missing)}: make its environment with tell={self.privileged}"
            )
        self.env = env
        self.seed = check_number("seed", seed, least=0, whole=True)
        self.num_timesteps = 0
        self._beginnings = TrialBeginnings()

    @classmethod
    def settings(cls, given: Settings) -> Settings:
        """All settings that it takes beside those that are given, with their defaults.

        Raises:
            ValueError: One that is given, and by which others are known, is not allowed.
        """
        return named_settings(cls)

    @classmethod
    def make(cls, env: gym.Env[Any, Any], **settings: Any) -> Agent:
        """One with plain settings, as `agents.make` gets them."""
        return cls(env, **settings)

    @abstractmethod
    def predict(
        self,
        observation: RawObservation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Control words for one observation or a batch of them.

        Args:
            observation: As the environment returns it; (n, ...) arrays for n environments.
            state: What the last call returned; None begins a new trial.
            episode_start: Where (n,) a new trial has begun.
            deterministic: Part of the surface; of no effect in agents that do not explore.

        Returns:
            Words (motors,) or (n, motors) in [-1, 1], and the state for the next call. Never changes
            knowledge.

        Raises:
            ValueError: The observation is none of such an environment, or the state is not what the last
                call returned.
        """

    @abstractmethod
    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """Makes `total_timesteps` more motions and learns from them, beginning with a new trial.

        Raises:
            ValueError: `total_timesteps` is no whole number, or negative.
        """

    @abstractmethod
    def save(self, path: AgentFile) -> None:
        """Writes what the agent knows, as a whole or not at all: numbers, never a pickle.

        Args:
            path: Of a file, whose folder is made where it is missing; or an open binary file.

        Raises:
            TypeError: It is neither.
        """

    @abstractmethod
    def load(self, path: AgentFile) -> Self:
        """Reads what `save` wrote into this agent, which then goes on as that one would.

        Args:
            path: As for `save`. An open file is read from where it stands on; where that is its end, from its
                beginning on.

        Raises:
            FileNotFoundError: There is no such file.
            TypeError: It is neither a path nor a binary file.
            ValueError: It is damaged, or of another agent, other settings or another number of motors; this
                agent is then as before.
        """
