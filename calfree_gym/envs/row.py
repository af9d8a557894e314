"""One row of a batched environment, as if it were a single one."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from calfree_gym.envs.arms.state import RowState
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.undo import Undo
from calfree_gym.world import World

if TYPE_CHECKING:
    from calfree_gym.envs.vector import StereoArmVectorEnv


class Row:
    """Has what a single environment has, but cannot be stepped alone; what is not its own is shared.

    Args:
        envs: The batched environment.
        row: Which row.
    """

    def __init__(self, envs: StereoArmVectorEnv, row: int) -> None:
        self._envs, self._row = envs, row

    @property
    def unwrapped(self) -> Row:
        """Itself."""
        return self

    @property
    def observation_space(self) -> gym.Space[Any]:
        """Of one row."""
        return self._envs.single_observation_space

    @property
    def action_space(self) -> gym.Space[Any]:
        """Of one row."""
        return self._envs.single_action_space

    @property
    def world(self) -> World:
        """As of a single environment."""
        return self._envs.arms.world(self._row)

    @property
    def home_seconds(self) -> float:
        """As of a single environment."""
        return float(self._envs.home_seconds[self._row])

    @property
    def applied(self) -> list[Perturbation | Undo]:
        """As of a single environment."""
        return self._envs.applied[self._row]

    def set_world(self, world: World) -> None:
        """As of a single environment."""
        self._envs.set_world(world, self._row)

    def get_state(self) -> RowState:
        """As of a single environment."""
        arms = self._envs.arms
        arms.check_begun(np.array([self._row]))
        return arms.get_state(self._row)

    def set_state(self, state: RowState) -> None:
        """As of a single environment."""
        self._envs.set_state(state, self._row)

    def __getattr__(self, name: str) -> Any:
        if name in ("reset", "step", "render", "close", "worlds"):
            raise AttributeError(
                f"a row has no {name!r} of its own: all rows of a batched environment share it"
            )
        return getattr(self._envs, name)


class HasRows:
    """The attributes of rows, under the names that Gymnasium's vector environments have for them."""

    num_envs: int

    def set_world(self, world: World, row: int | None = None) -> None:
        """Puts a row into a world."""
        raise NotImplementedError

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Calls a method of each row, such as `set_world`, or gets an attribute of each."""
        envs: Any = self
        found = [getattr(Row(envs, row), name) for row in range(self.num_envs)]
        return tuple(each(*args, **kwargs) if callable(each) else each for each in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each row, such as `world`: what a single environment would have."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Sets an attribute: the `world` of each row, given as one or as a list; any other for all rows.

        Raises:
            ValueError: There are more or fewer values than rows, rows would differ in what they share, or it
                is an argument that only a new environment can take.
        """
        if name != "world" and name in inspect.signature(type(self)).parameters:
            raise ValueError(f"{name} is an argument of make_vec; make another environment to change it")
        each = list(values) if isinstance(values, list | tuple) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise ValueError(
                f"{name} got {len(each)} values; it must get {self.num_envs}, one a row, or one for all"
            )
        if name == "world":
            for row, world in enumerate(each):
                self.set_world(world, row)
        elif all(value == each[0] for value in each):
            setattr(self, name, each[0])
        else:
            raise ValueError(f"{name} got {each}; all rows share it, so that it must be the same for each")
