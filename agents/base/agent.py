"""The one surface that every agent has, and how a servo written as a coroutine gets it.

The surface is that of a stable-baselines3 algorithm: `predict`, `learn`, `save`, `load`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.base import storage

Array = NDArray[np.float64]
Observation = Mapping[str, NDArray[Any]]

POINTS = 4
"""Visibility flags at the head of `observation`: gripper left, right, object left, right."""
SEEN = ("achieved_goal", "desired_goal", "observation")
"""What every controller is given; all else in an observation was asked for by `tell=`."""


@dataclass(frozen=True)
class Look:
    """What a controller sees once the arm has settled.

    Attributes:
        gripper: The gripper's sensor vector (4,), in image units.
        object: The object's sensor vector (4,).
        visible: Which of the points are seen now (4,): gripper left, right, object left, right.
        registers: Executed sums of control words since home (m,).
        told: What was asked for by `tell=`, by its name.
    """

    gripper: Array
    object: Array
    visible: NDArray[np.bool_]
    registers: Array
    told: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, observation: Observation) -> Look:
        """The look in one environment's observation."""
        seen = np.asarray(observation["observation"], float)
        return cls(
            gripper=np.asarray(observation["achieved_goal"], float),
            object=np.asarray(observation["desired_goal"], float),
            visible=seen[:POINTS] > 0.5,
            registers=seen[POINTS:],
            told={name: np.asarray(observation[name], float) for name in observation if name not in SEEN},
        )

    def believed(self, points: Array, visible: NDArray[np.bool_]) -> Look:
        """The same look with gripper and object points (8,), and flags (4,), as they are believed."""
        return Look(points[:4], points[4:], visible, self.registers, self.told)

    @property
    def distance(self) -> Array:
        """The image distance d (4,): gripper point minus object point, in sensor space."""
        return self.gripper - self.object


Procedure = Generator[Array, Look, None]
"""A servo at work on one trial: yields control words, is sent what was seen after them."""


class Progress(Protocol):
    """What a callback of `learn` is told."""

    num_timesteps: int


Callback = Callable[[Progress], bool]
"""Called after every motion; returning False ends `learn`."""


class Agent(ABC):
    """A controller of the black box.

    Attributes:
        told: What it was told beyond its observations, by the names of `tell=`; empty for most.
        num_timesteps: Motions that it has made in `learn`, over its whole life.
    """

    told: ClassVar[tuple[str, ...]] = ()

    def __init__(self, env: gym.Env[Any, Any], seed: int = 0) -> None:
        spaces: Mapping[str, Any] = getattr(env.observation_space, "spaces", {})
        if missing := [name for name in self.told if name not in spaces]:
            raise ValueError(
                f"it must be told {', '.join(missing)}: make its environment with tell={self.told}"
            )
        self.env = env
        self.seed = seed
        self.num_timesteps = 0

    @abstractmethod
    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Control words for one observation or a batch of them.

        Args:
            observation: As the environment gives it; (n, ...) arrays for n environments.
            state: What the last call returned; None begins a new trial.
            episode_start: Where (n,) a new trial has begun.
            deterministic: Taken for the surface's sake by agents that do not explore.

        Returns:
            Words (motors,) or (n, motors), and the state for the next call. Never changes knowledge.
        """

    @abstractmethod
    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """Makes `total_timesteps` more motions and learns from them, beginning with a new trial."""

    @abstractmethod
    def save(self, path: str | Path) -> None:
        """Writes what the agent knows to `path`."""

    @abstractmethod
    def load(self, path: str | Path) -> Self:
        """Reads what `save` wrote into this agent."""


class ProcedureAgent(Agent):
    """An agent whose behaviour in one trial is a coroutine."""

    @abstractmethod
    def procedure(self, look: Look) -> Procedure:
        """Seeks the rendezvous from the trial's first look; may end, after which the agent only looks."""

    @property
    @abstractmethod
    def kind(self) -> str:
        """What it is, settings and all: it loads only what its like has saved."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays; nothing, unless it learns."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned."""

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """Learns from a trial of its own; a trial cut off (`ended` False) teaches no end."""

    def predict(
        self,
        observation: Observation,
        state: list[Procedure] | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], list[Procedure]]:
        """See `Agent`. The state is opaque and consumed by the call.

        Raises:
            ValueError: `state` is None in the middle of a trial, or of another number of environments.
        """
        single = np.ndim(observation["achieved_goal"]) == 1
        rows = [observation] if single else _rows(observation)
        starts = np.zeros(len(rows), bool) if episode_start is None else np.atleast_1d(episode_start)
        if state is not None and len(state) != len(rows):
            raise ValueError(f"the state is of {len(state)} environments, the observation of {len(rows)}")
        if len(starts) != len(rows):
            raise ValueError(f"episode_start has {len(starts)} entries for {len(rows)} environments")
        words, after = [], []
        for i, row in enumerate(rows):
            look = Look.of(row)
            if state is None or starts[i]:
                if not starts[i] and np.abs(look.registers).max() > 0:
                    raise ValueError(
                        "predict got state=None in the middle of a trial (registers are "
                        f"{look.registers.tolist()}): pass the state back that the last call returned, "
                        "or episode_start where a new trial begins"
                    )
                running = self.procedure(look)
                words.append(_begin(running, look))
            else:
                running = state[i]
                words.append(_resume(running, look))
            after.append(running)
        stacked = np.asarray(words, np.float32)
        return (stacked[0] if single else stacked), after

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """See `Agent`."""
        target = self.num_timesteps + total_timesteps
        while self.num_timesteps < target:
            observation, _ = self.env.reset()
            look = Look.of(observation)
            looks, running = [look], self.procedure(look)
            words = _begin(running, look)
            while True:
                observation, _, terminated, truncated, _ = self.env.step(words.astype(np.float32))
                look = Look.of(observation)
                looks.append(look)
                self.num_timesteps += 1
                if terminated or truncated:
                    self.learn_trial(looks, ended=bool(terminated))
                go_on = callback is None or callback(self)
                if terminated or truncated or not go_on or self.num_timesteps >= target:
                    break
                words = _resume(running, look)
            if not go_on:
                break
        return self

    def save(self, path: str | Path) -> None:
        """See `Agent`."""
        storage.save(path, self.kind, self.arrays(), self.num_timesteps)

    def load(self, path: str | Path) -> Self:
        """See `Agent`.

        Raises:
            ValueError: The file is damaged, no saved agent, or of another kind or other settings.
        """
        arrays, motions = storage.load(path, self.kind)
        before = self.arrays()
        try:
            self.restore(arrays)
        except (KeyError, ValueError) as error:
            self.restore(before)
            raise ValueError(f"{path} is damaged: {error}") from error
        self.num_timesteps = motions
        return self


def relive(running: Procedure, looks: Sequence[Look]) -> None:
    """Leads a procedure once more through a trial's looks, to what it then made of them.

    So a procedure that keeps what it finds out in something that it is given teaches an agent in
    `learn_trial`, and changes nothing in `predict`.
    """
    _begin(running, looks[0])
    for look in looks[1:]:
        _resume(running, look)


def _begin(running: Procedure, look: Look) -> Array:
    return next(running, np.zeros(len(look.registers)))


def _resume(running: Procedure, look: Look) -> Array:
    """The procedure's next words; zero words, a look, once it has ended."""
    try:
        return running.send(look)
    except StopIteration:
        return np.zeros(len(look.registers))


def _rows(observation: Observation) -> list[Observation]:
    count = len(observation["achieved_goal"])
    return [{key: value[i] for key, value in observation.items()} for i in range(count)]
