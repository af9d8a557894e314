"""Many black boxes stepped together, as a Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from calfree_gym.arms import Perturbed, WorldChoice
from calfree_gym.goal import (
    RENDER_MODES,
    Observation,
    StereoArmGoal,
    action_space,
    control_words,
    observation_space,
    placed_objects,
)
from calfree_gym.motors import MOTORS
from calfree_gym.tasks import reach
from calfree_gym.world import World


class StereoArmVectorEnv(StereoArmGoal, VectorEnv[Any, Any, Any]):
    """Many stereo arms stepped together by MuJoCo's threads; row i is `StereoArmEnv` reset with seed + i.

    A finished row begins its next trial at the next step, whatever its action (`AutoresetMode.NEXT_STEP`).

    Args:
        num_envs: Rows.
        max_episode_steps: Motions after which a trial is truncated.
        threads: Threads of the simulation (0: all cores); they change no number.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `StereoArmEnv`.
    """

    metadata = {  # noqa: RUF012
        "render_modes": list(RENDER_MODES),
        "render_fps": 2,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int = 60,
        threads: int = 0,
        world: WorldChoice | Sequence[WorldChoice] = "wild",
        camera_mount: str = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        dynamics: str = "physics",
        perturbations: Any = None,
        terminate_on_success: bool = True,
        reward: str = "sparse",
        render_mode: str | None = None,
    ) -> None:
        self._build(
            num_envs,
            threads,
            reward,
            observation,
            terminate_on_success,
            render_mode,
            world=world,
            camera_mount=camera_mount,
            tolerance_px=tolerance_px,
            dynamics=dynamics,
            perturbations=perturbations,
        )
        self.num_envs = num_envs
        if max_episode_steps < 1:
            raise ValueError(f"max_episode_steps is {max_episode_steps}; it must be 1 or more")
        self._max_episode_steps = max_episode_steps
        self.single_observation_space = observation_space()
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._steps = np.zeros(num_envs, np.int64)
        self._over = np.zeros(num_envs, bool)

    @property
    def worlds(self) -> list[World]:
        """The hidden world of each row. For experiments, not for controllers."""
        return [self.arms.world(row) for row in range(self.num_envs)]

    def set_world(self, world: World, row: int | None = None) -> None:
        """Puts one row, or every row, into `world`; later seeds draw objects and noise only."""
        for r in range(self.num_envs) if row is None else [row]:
            self.arms.set_world(r, world)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins a trial in every row.

        Args:
            seed: Row i is seeded with seed + i; or one seed a row, None where a row just goes on.
            options: {"object": (x, y, z)} or one object a row (num_envs, 3), in m.
        """
        for row, row_seed in enumerate(self._row_seeds(seed)):
            if row_seed is not None:
                self.arms.seed(row, row_seed)
        self._steps[:] = 0
        self._over[:] = False
        struck = self.arms.begin_trial(slice(None), placed_objects(options, self.num_envs))
        self.arms.look()
        achieved, desired = self._goals()
        distances = reach.image_distances(achieved, desired)
        success = reach.rendezvous(distances, self.arms.tolerance)
        infos = self._infos(success, np.zeros(self.num_envs), struck)
        return self._observation(achieved, desired), infos

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """Executes one motion in every row whose trial is not over; the others begin the next trial."""
        words = control_words(actions, (self.num_envs, len(MOTORS)))
        over, seconds = self._over, np.zeros(self.num_envs)
        struck: list[Perturbed] = []
        if over.any():
            moving, beginning = np.flatnonzero(~over), np.flatnonzero(over)
            struck += self.arms.begin_trial(beginning)
            self._steps[beginning] = -1
            if len(moving):
                seconds[moving], more = self.arms.move(moving, words[moving])
                struck += more
        else:
            seconds, struck = self.arms.move(slice(None), words)
        self.arms.look()
        self._steps += 1
        achieved, desired = self._goals()
        distances = reach.image_distances(achieved, desired)
        success = reach.rendezvous(distances, self.arms.tolerance)
        rewards = np.where(over, 0.0, self._reward(distances, success))
        terminated = success & ~over if self._ends else np.zeros(self.num_envs, bool)
        truncated = self._steps >= self._max_episode_steps
        self._over = terminated | truncated
        infos = self._infos(success, seconds, struck)
        return self._observation(achieved, desired), rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...]:
        """One frame a row, as `StereoArmEnv.render`."""
        return tuple(self._frame(row) for row in range(self.num_envs))

    def _row_seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        rows = range(self.num_envs)
        if isinstance(seed, int | np.integer):
            return [int(seed) + row for row in rows]
        seeds = [None] * self.num_envs if seed is None else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed has {len(seeds)} entries; it must have {self.num_envs}, one a row")
        drawn = int(self.np_random.integers(2**31))
        return [
            drawn + row if seeds[row] is None and self.arms.needs_seed(row) else seeds[row] for row in rows
        ]

    def _observation(self, achieved: Any, desired: Any) -> Observation:
        return {
            "achieved_goal": achieved,
            "desired_goal": desired,
            "observation": self._flags_and_registers(),
        }

    def _infos(self, success: Any, seconds: Any, struck: list[Perturbed]) -> dict[str, Any]:
        every = np.ones(self.num_envs, bool)
        truth = self._truth()
        truth |= {"_" + key: every for key in truth}
        perturbed = np.empty(self.num_envs, object)
        for row, perturbation in struck:
            perturbed[row] = [*(perturbed[row] or ()), perturbation]
        infos = {
            "is_success": success,
            "robot_seconds": seconds,
            "perturbed": perturbed,
            "truth": truth,
        }
        was_perturbed = np.array([what is not None for what in perturbed])
        return infos | {"_" + key: every for key in infos} | {"_perturbed": was_perturbed}

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the renderer, if an image was ever asked for."""
        self._free_renderer()
