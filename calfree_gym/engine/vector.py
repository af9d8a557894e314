"""The batched environment: all rows of the engine, as a Gymnasium vector environment."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from calfree_gym.engine.arms import Events, RowState
from calfree_gym.engine.config import RENDER_MODES, Config
from calfree_gym.engine.environment import Environment
from calfree_gym.engine.spaces import Observation, checked_options, control_words
from calfree_gym.errors import check_choice, check_whole
from calfree_gym.geometry import Flags
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import Applied, Undo
from calfree_gym.world import World

MOST_ROWS, LONGEST_TRIAL, MOST_THREADS, LARGEST_SEED = 2**20, 2**31, 2**10, 2**64
"""Rows, motions of a trial, threads and seeds of a batched environment (guards)."""
NO_LIMIT = -1
"""Of motions of a trial, as for `gymnasium.make`."""


@dataclass(kw_only=True)
class Batch:
    """The arguments that batched environments have besides those of their task."""

    num_envs: int = 1
    max_episode_steps: int = 60
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP
    threads: int = 0

    def __post_init__(self) -> None:
        """Checks them.

        Raises:
            ValueError: An argument is not allowed.
        """
        check_whole("num_envs", self.num_envs, 1, MOST_ROWS)
        if self.max_episode_steps != NO_LIMIT:
            check_whole("max_episode_steps", self.max_episode_steps, 1, LONGEST_TRIAL, ", or -1: no limit")
        check_whole("threads", self.threads, 0, MOST_THREADS)
        mode = getattr(self.autoreset_mode, "value", self.autoreset_mode)
        check_choice("autoreset_mode", mode, tuple(mode.value for mode in AutoresetMode))


class ArmVectorEnv(Environment, VectorEnv[Any, Any, Any]):
    """Many arms: what a batched environment of any task has."""

    metadata = {  # noqa: RUF012
        "render_modes": list(RENDER_MODES),
        "render_fps": 2,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    configs = (Batch,)

    def _build(self, batch: Batch, config: Config) -> None:
        self._make(config, batch.num_envs, batch.threads)
        self.num_envs = batch.num_envs
        limit = batch.max_episode_steps
        self._max_episode_steps = np.inf if limit == NO_LIMIT else limit
        self.autoreset_mode = AutoresetMode(batch.autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = self.arms.make_spaces()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._action_shape = tuple(self.single_action_space.shape or ())
        self._over = np.zeros(self.num_envs, bool)
        self._applied: list[Applied] = []

    @property
    def worlds(self) -> list[World]:
        """The hidden world of each row. For experiments, not for controllers."""
        return [self.arms.world(row) for row in range(self.num_envs)]

    @property
    def applied(self) -> list[list[Perturbation | Undo]]:
        """What was applied to each row in the last step or reset."""
        listed: list[list[Perturbation | Undo]] = [[] for _ in range(self.num_envs)]
        for row, perturbation in self._applied:
            listed[row].append(perturbation)
        return listed

    @property
    def home_seconds(self) -> NDArray[np.float64]:
        """Robot time (num_envs,) of the way home from here, as `infos["robot_seconds"]` is of a motion."""
        return self.arms.home_seconds()

    def set_world(self, world: World, row: int | None = None) -> None:
        """Puts one row, or every row, into `world`; later seeds draw objects and noise only."""
        if row is not None:
            check_whole("row", row, 0, self.num_envs - 1)
        for r in range(self.num_envs) if row is None else [row]:
            self.arms.set_world(r, world)

    def get_state(self) -> tuple[RowState, ...]:
        """The state of each row, as `StereoArmEnv.get_state`.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun in some row.
        """
        self.arms.check_begun()
        return tuple(self.arms.get_state(row) for row in range(self.num_envs))

    def set_state(self, state: RowState | Sequence[RowState], row: int | None = None) -> None:
        """Brings every row into its state, one row, or all rows into one state: that of a single arm, too.

        Motions of the trial count for `max_episode_steps`.

        Raises:
            ValueError: There are more or fewer states than rows, no such row, or one is that of another arm.
        """
        if row is not None:
            check_whole("row", row, 0, self.num_envs - 1)
        rows = range(self.num_envs) if row is None else [row]
        states = [state] * len(rows) if isinstance(state, Mapping) else list(state)
        if len(states) != len(rows):
            raise ValueError(
                f"there are {len(states)} states; there must be {len(rows)}, one a row, or one for all"
            )
        for each, of_row in zip(rows, states, strict=True):
            self.arms.set_state(each, of_row)
        self.arms.simulation.refresh()
        *_, success = self.arms.outcome()
        moved = self.arms.motions_of_trial > 0
        late = self.arms.motions_of_trial >= self._max_episode_steps
        self._over = moved & (success & self._ends | late | self.arms.cut_short(self.arms.events()))
        self._applied = []

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins a trial in every row, or in those of a mask.

        Args:
            seed: Row i is seeded with seed + i; or one seed a row, None where a row just goes on.
            options: {"object": (x, y, z)} or one object a row (num_envs, 3), in m; {"reset_mask": (num_envs,)
                of bool}: only these rows begin a trial, the others stay as they are.
        """
        given = checked_options(options)
        rows = self._masked(given.pop("reset_mask", None))
        objects = self.arms.objects_of(given)
        seeds = self._row_seeds(seed)
        for row in rows:
            if (row_seed := seeds[row]) is not None:
                self.arms.seed(row, row_seed)
        self._applied = self._begin(rows, None if objects is None else objects[rows])
        self.arms.observe()
        self._show()
        observation, _, success = self.arms.outcome()
        return observation, self._infos(success, np.zeros(self.num_envs), self._applied, self.arms.events())

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """Executes one motion in every row whose trial is not over.

        Raises:
            gymnasium.error.ResetNeeded: A trial is over and the next was not begun (autoreset disabled).
        """
        words = control_words(actions, (self.num_envs, *self._action_shape))
        over, beginning = self._over.copy(), np.flatnonzero(self._over)
        seconds = np.zeros(self.num_envs)
        if not len(beginning):
            seconds, applied = self.arms.move(slice(None), words)
        elif self.autoreset_mode is not AutoresetMode.DISABLED:
            applied = self._begin(beginning)
            moving = np.flatnonzero(~over)
            if len(moving):
                seconds[moving], more = self.arms.move(moving, words[moving])
                applied += more
        else:
            raise gym.error.ResetNeeded(
                f"the trials of rows {beginning.tolist()} are over: reset them, with a reset_mask in options"
            )
        self.arms.observe()
        observation, distances, success = self.arms.outcome()
        events = self.arms.events()
        rewards = np.where(over, 0.0, self._reward(distances, success))
        terminated = success & ~over if self._ends else np.zeros(self.num_envs, bool)
        truncated = (self.arms.motions_of_trial >= self._max_episode_steps) | self.arms.cut_short(
            events
        ) & ~over
        self._over = terminated | truncated
        self._applied = applied
        at_once = self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any()
        told = self._over.copy() if at_once else None
        infos = self._infos(success, seconds, applied, events, told)
        if told is not None:
            observation, infos = self._begin_at_once(observation, infos, told)
        self._show()
        return observation, rewards, terminated, truncated, infos

    def _begin(self, rows: NDArray[np.intp], objects: NDArray[np.float64] | None = None) -> list[Applied]:
        self._over[rows] = False
        return self.arms.begin_trial(rows, objects)

    def _begin_at_once(
        self, final: Observation, final_infos: dict[str, Any], over: Flags
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins the next trials of the rows that are over; their last observations go into infos."""
        begun = self._begin(np.flatnonzero(over))
        applied = [each for each in self._applied if not over[each[0]]] + begun
        self._applied = [*self._applied, *begun]
        self.arms.observe()
        observation, _, success = self.arms.outcome()
        seconds = np.where(over, 0.0, final_infos["robot_seconds"])
        infos = self._infos(success, seconds, applied, self.arms.events())
        return observation, infos | final_of_rows(final, final_infos, over)

    def render(self) -> Any:
        """One frame a row, as `StereoArmEnv.render`; None without a render mode.

        With render_mode="human" MuJoCo's viewer shows the first row.
        """
        if self.render_mode == "human":
            return self._frame(0)
        frames = tuple(self._frame(row) for row in range(self.num_envs))
        return frames if self.render_mode else None

    def _row_seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        rows = range(self.num_envs)
        if isinstance(seed, int | float | np.number):
            check_whole("seed", seed, 0, LARGEST_SEED)
            return [int(seed) + row for row in rows]
        seeds = [None] * self.num_envs if seed is None else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed has {len(seeds)} entries; it must have {self.num_envs}, one a row")
        for row, of_row in enumerate(seeds):
            if of_row is not None:
                check_whole(f"seed[{row}]", of_row, 0, LARGEST_SEED)
        drawn = int(self.np_random.integers(2**31))
        return [
            drawn + row if seeds[row] is None and self.arms.needs_seed(row) else seeds[row] for row in rows
        ]

    def _masked(self, mask: Any) -> NDArray[np.intp]:
        """The rows that a reset is for."""
        if mask is None:
            return np.arange(self.num_envs)
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] is {mask!r}; it must be a bool array ({self.num_envs},)")
        if not mask.any():
            raise ValueError("options['reset_mask'] is False everywhere; at least one row must begin")
        return np.flatnonzero(mask)

    def _infos(
        self,
        success: Any,
        seconds: Any,
        applied: list[Applied],
        events: Events,
        told: Flags | None = None,
    ) -> dict[str, Any]:
        """Infos that are told of some rows (num_envs,), by default of all."""
        every = np.ones(self.num_envs, bool) if told is None else told
        perturbed = np.bincount([row for row, _ in applied], minlength=self.num_envs)
        infos = {"is_success": success, "robot_seconds": seconds, "perturbed": perturbed} | events
        if self._gives_truth:
            truth = self.arms.truth()
            infos["truth"] = truth | {"_" + key: every for key in truth}
        return infos | {"_" + key: every for key in infos}

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Calls a method of each row, such as `set_world`, or gets an attribute of each."""
        found = [getattr(Row(self, row), name) for row in range(self.num_envs)]
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

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the renderer."""
        self._close()


def final_of_rows(observation: Observation, infos: dict[str, Any], over: Flags) -> dict[str, Any]:
    """What infos tell of trials that are over, in the form of Gymnasium's own vector environments.

    Args:
        observation: Of all rows, before the next trials.
        infos: Of all rows, then.
        over: Whose trials (N,) are over.

    Returns:
        `final_obs` is an array (N,) of objects: the row's last observation, or None.
    """
    final = np.full(len(over), None)
    for row in np.flatnonzero(over).tolist():
        final[row] = {name: of_rows[row] for name, of_rows in observation.items()}
    return {"final_obs": final, "_final_obs": over, "final_info": infos, "_final_info": over}


class Row:
    """Has what a single environment has, but cannot be stepped alone; what is not its own is shared.

    Args:
        envs: The batched environment.
        row: Which row.
    """

    def __init__(self, envs: ArmVectorEnv, row: int) -> None:
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
