"""The batched environment: many arms stepped together, as a Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from calfree_gym.envs.arms.state import RowState
from calfree_gym.envs.reaching import Reaching, checked_options
from calfree_gym.envs.row import HasRows
from calfree_gym.envs.shared import RENDER_MODES, ArmShared, Events, GoalRewards
from calfree_gym.envs.spaces import GOALS, Observation, control_words
from calfree_gym.errors import check_choice, check_whole, known_arguments
from calfree_gym.perturbations.application import Applied
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.undo import Undo
from calfree_gym.robot.arms.arm import ArmChoice
from calfree_gym.world import World, WorldChoice

MOST_ROWS, LONGEST_TRIAL, MOST_THREADS, LARGEST_SEED = 2**20, 2**31, 2**10, 2**64
"""Rows, motions of a trial, threads and seeds of a batched environment (guards)."""
NO_LIMIT = -1
"""Of motions of a trial, as for `gymnasium.make`."""


class ArmVectorEnv(ArmShared, HasRows, VectorEnv[Any, Any, Any]):
    """Many arms: what a batched environment of any task has."""

    metadata = {  # noqa: RUF012
        "render_modes": list(RENDER_MODES),
        "render_fps": 2,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def _build_rows(
        self,
        arguments: dict[str, Any],
    ) -> None:
        del arguments["self"]
        num_envs, max_episode_steps, autoreset_mode, threads = (
            arguments.pop(name) for name in ("num_envs", "max_episode_steps", "autoreset_mode", "threads")
        )
        check_whole("num_envs", num_envs, 1, MOST_ROWS)
        if max_episode_steps != NO_LIMIT:
            check_whole("max_episode_steps", max_episode_steps, 1, LONGEST_TRIAL, ", or -1: no limit")
        check_whole("threads", threads, 0, MOST_THREADS)
        modes = tuple(mode.value for mode in AutoresetMode)
        check_choice("autoreset_mode", getattr(autoreset_mode, "value", autoreset_mode), modes)
        self._build(num_envs, threads, **arguments)
        self.num_envs = num_envs
        self._max_episode_steps = np.inf if max_episode_steps == NO_LIMIT else max_episode_steps
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = self._spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._action_shape = tuple(self.single_action_space.shape or ())
        self._over = np.zeros(num_envs, bool)
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
        *_, success = self._outcome()
        moved = self.arms.motions_of_trial > 0
        late = self.arms.motions_of_trial >= self._max_episode_steps
        self._over = moved & (success & self._ends | late | self._cut_short(self._events()))
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
        objects = self._placed(given)
        seeds = self._row_seeds(seed)
        for row in rows:
            if (row_seed := seeds[row]) is not None:
                self.arms.seed(row, row_seed)
        self._applied = self._begin(rows, None if objects is None else objects[rows])
        self.arms.observe()
        self._show()
        observation, _, success = self._outcome()
        return observation, self._infos(success, np.zeros(self.num_envs), self._applied, self._events())

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
        elif self.autoreset_mode is AutoresetMode.NEXT_STEP:
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
        observation, distances, success = self._outcome()
        events = self._events()
        rewards = np.where(over, 0.0, self._reward(distances, success))
        terminated = success & ~over if self._ends else np.zeros(self.num_envs, bool)
        truncated = (self.arms.motions_of_trial >= self._max_episode_steps) | self._cut_short(events) & ~over
        self._over = terminated | truncated
        self._applied = applied
        infos = self._infos(success, seconds, applied, events)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            observation, infos = self._begin_at_once(observation, infos)
        self._show()
        return observation, rewards, terminated, truncated, infos

    def _begin(self, rows: NDArray[np.intp], objects: NDArray[np.float64] | None = None) -> list[Applied]:
        self._over[rows] = False
        return self.arms.begin_trial(rows, objects)

    def _begin_at_once(
        self, final: Observation, final_infos: dict[str, Any]
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins the next trials of the rows that are over; their last observations go into infos."""
        over = self._over.copy()
        begun = self._begin(np.flatnonzero(over))
        applied = [each for each in self._applied if not over[each[0]]] + begun
        self._applied = [*self._applied, *begun]
        self.arms.observe()
        observation, _, success = self._outcome()
        seconds = np.where(over, 0.0, final_infos["robot_seconds"])
        infos = self._infos(success, seconds, applied, self._events())
        return observation, infos | {
            "final_obs": final,
            "_final_obs": over,
            "final_info": final_infos,
            "_final_info": over,
        }

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

    def _infos(self, success: Any, seconds: Any, applied: list[Applied], events: Events) -> dict[str, Any]:
        every = np.ones(self.num_envs, bool)
        perturbed = np.bincount([row for row, _ in applied], minlength=self.num_envs)
        infos = {"is_success": success, "robot_seconds": seconds, "perturbed": perturbed} | events
        if self._gives_truth:
            truth = self._truth()
            infos["truth"] = truth | {"_" + key: every for key in truth}
        return infos | {"_" + key: every for key in infos}

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the renderer."""
        self._close()


class StereoArmVectorEnv(Reaching, ArmVectorEnv):
    """Many stereo arms stepped together by MuJoCo's threads; row i is `StereoArmEnv` reset with seed + i.

    Each row counts its own motions and trials, and perturbations are applied by these counts.

    Args:
        num_envs: Rows.
        max_episode_steps: Motions after which a trial is truncated; -1: never.
        autoreset_mode: Of `gymnasium.vector.AutoresetMode`. NEXT_STEP: a row whose trial is over begins the
            next one at the next step, which ignores its action. SAME_STEP: at once; its last observation is
            in `infos["final_obs"]`. DISABLED: by `reset(options={"reset_mask": ...})`.
        threads: Threads of the simulation (0: all cores); they change no number.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `StereoArmEnv`.
    """

    @known_arguments
    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int = 60,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        world: WorldChoice | Sequence[WorldChoice] = "wild",
        arm: ArmChoice = "movemaster",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        dynamics: str = "physics",
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        tell: Sequence[str] = (),
        truth: bool = True,
        occlusion: bool = False,
        image_size: int = 128,
        reward: str = "sparse",
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_rows(locals())


class StereoArmGoalVectorEnv(GoalRewards, StereoArmVectorEnv):
    """A `StereoArmVectorEnv` that observes image points: hindsight relabelling can compute its reward."""


def make(**arguments: Any) -> StereoArmVectorEnv:
    """The environment of these arguments; for `gymnasium.make_vec`."""
    goals = arguments.get("observation", "points") in GOALS
    return StereoArmGoalVectorEnv(**arguments) if goals else StereoArmVectorEnv(**arguments)
