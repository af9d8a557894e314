"""The one surface that every agent has: that of a stable-baselines3 algorithm, without needing it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .checks import check_number
from .observation import STANDARD_KEYS, Array, Flags, RawObservation
from .prior_knowledge import PriorKnowledge
from .registers import RegisterEstimate
from .registration import Settings, named_settings
from .storage import AgentFile


def is_of_one(observation: Any, space: gym.Space[Any]) -> bool:
    """Whether an observation is of one environment, not of several.

    Args:
        observation: What `predict` was given.
        space: Of the agent's own environment.

    Raises:
        ValueError: It is no observation of such environments, or holds a number that is not finite.
    """
    if not isinstance(observation, Mapping):
        raise ValueError(f"the observation is {observation!r}; it must be a mapping of {_KEYS}")
    for key in STANDARD_KEYS:
        if key not in observation:
            raise ValueError(f"the observation has {', '.join(map(str, observation))}; it must have {_KEYS}")
        found, wanted = np.asarray(observation[key]), space[key].shape  # type: ignore[index]
        if found.ndim not in (1, 2) or found.shape[-1:] != wanted:
            raise ValueError(
                f"the observation's {key} has shape {found.shape}; it must be {wanted}, or (n, {wanted[0]}) "
                "of n environments, as in the environment that the agent was made with"
            )
        if not np.isfinite(found).all():
            raise ValueError(f"the observation's {key} is {found.tolist()}; all numbers must be finite")
    rows = {key: np.shape(observation[key])[:-1] for key in STANDARD_KEYS}
    if len(set(rows.values())) > 1:
        raise ValueError(f"the observation has rows {rows}; all keys must have as many, or none")
    return bool(np.ndim(observation[STANDARD_KEYS[0]]) == 1)


def foreign(found: str) -> ValueError:
    """The error where `predict` was given a state that its agent has not returned: one that "is 5"."""
    return ValueError(f"the state {found}; pass the state back that this agent's last call returned")


_KEYS = ", ".join(STANDARD_KEYS)


class TrialBeginnings:
    """Tells where trials begin, and where a caller has lost the state in the middle of one.

    Registers at home are measured: near zero, not zero. So it also knows what was told last: registers that
    stand where those words led, away from home, are of the middle of a trial, however small the words were.
    """

    def __init__(self) -> None:
        self._registers, self._words = np.zeros((2, 0, 0))

    def sent(self, registers: Array, words: NDArray[np.floating]) -> None:
        """Words (n, m), or (m,), were sent where registers were (n, m)."""
        self._registers, self._words = registers, np.reshape(np.asarray(words, float), registers.shape)

    def where(self, registers: Array, rows_of_state: int | None, episode_start: Flags | None) -> Flags:
        """Where (n,) a new trial begins.

        Args:
            registers: Of a batch of n environments (n, m).
            rows_of_state: How many environments the state is of; None where there is no state.
            episode_start: Where (n,) the caller says that one begins.

        Raises:
            ValueError: There is no state in the middle of a trial, or it is of another number of rows.
        """
        rows = len(registers)
        starts = np.zeros(rows, bool) if episode_start is None else np.atleast_1d(episode_start)
        if rows_of_state is not None and rows_of_state != rows:
            raise ValueError(f"the state is of {rows_of_state} environments, the observation of {rows}")
        if len(starts) != rows:
            raise ValueError(f"episode_start has {len(starts)} entries for {rows} environments")
        if rows_of_state is not None:
            return np.asarray(starts, bool)
        far = (np.abs(registers) >= RegisterEstimate.HOME).any(1)
        away = ~starts.astype(bool) & (far | self._led(registers))
        if away.any():
            raise ValueError(
                "predict got state=None in the middle of a trial (registers are "
                f"{registers[away.argmax()].tolist()}): pass the state back that the last call returned, "
                "or episode_start where a new trial begins"
            )
        return np.ones(rows, bool)

    def _led(self, registers: Array) -> Flags:
        """Where (n,) the last words led to these registers (n, m), away from home."""
        if registers.shape != self._registers.shape:
            return np.zeros(len(registers), bool)
        far = np.abs(self._words).max(1) / 2
        off = np.abs(registers - self._registers - self._words).max(1)
        return np.asarray((off < far) & (np.abs(registers).max(1) > far))


class Progress(Protocol):
    """What a callback of `learn` gets."""

    num_timesteps: int


Callback = Callable[[Progress], bool]
"""Called after every motion; returning False ends `learn`."""


class Agent(ABC):
    """A controller of the black box.

    Attributes:
        name: Under which `agents.make` made it; else empty.
        privileged: What it requires beyond the standard observations, by the names of `tell=`; mostly empty.
        prior_knowledge: What it is built on beyond its observations, which every table prints; an agent of
            your own sets it, to an empty one where that is nothing.
        rows: How many arms, all in one world, it learns from at once where it can.
        num_timesteps: Motions that it has made in `learn`, over its whole life.

    Args:
        env: The environment that it learns in, and whose spaces it acts in.
        seed: Of all that it draws.

    Raises:
        ValueError: The environment does not tell what it requires, or a setting is not allowed.
    """

    name: str = ""
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
            ValueError: The observation is none of such an environment, see `is_of_one`; or the state is not
                what the last call returned: it is None in the middle of a trial, of another number of
                environments, or of another agent.
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
