"""What the single and the batched environment share: arguments, spaces, observations, rewards."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.arms import StereoArms, check_choice
from calfree_gym.motors import MOTORS
from calfree_gym.tasks import reach

Observation = dict[str, NDArray[np.float32]]
REWARDS = {"sparse": reach.sparse_reward, "dense": reach.dense_reward}
OBSERVATIONS = ("points",)
RENDER_MODES = ("rgb_array",)


def observation_space() -> spaces.Dict[Any]:
    """The observations of one arm."""
    sizes = {"achieved_goal": 4, "desired_goal": 4, "observation": 4 + len(MOTORS)}
    return spaces.Dict({key: spaces.Box(-1.0, 1.0, (size,), np.float32) for key, size in sizes.items()})


def action_space() -> spaces.Box[Any]:
    """The control words of one arm."""
    return spaces.Box(-1.0, 1.0, (len(MOTORS),), np.float32)


def control_words(action: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Control words from an action, clipped to [-1, 1].

    Raises:
        ValueError: The action has another shape, or is not finite.
    """
    words = np.asarray(action, np.float64)
    if words.shape != shape:
        raise ValueError(f"the action has shape {words.shape}; it must be {shape}, one word a motor")
    if np.abs(words).max() <= 1:
        return words
    if not np.isfinite(words).all():
        raise ValueError(f"the action is {words.tolist()}; control words must be finite, in [-1, 1]")
    return np.clip(words, -1.0, 1.0)


class StereoArmGoal:
    """What the single and the batched environment share: arguments, observations, rewards."""

    def _build(
        self,
        rows: int,
        threads: int,
        reward: str,
        observation: str,
        terminate_on_success: bool,
        render_mode: Any,
        **arms: Any,
    ) -> None:
        check_choice("reward", reward, tuple(REWARDS))
        check_choice("observation", observation, OBSERVATIONS)
        if render_mode is not None:
            check_choice("render_mode", render_mode, RENDER_MODES)
        self.arms = StereoArms(rows, threads=threads, **arms)
        self.render_mode = render_mode
        self._ends = terminate_on_success
        self.tolerance_px = float(arms["tolerance_px"])
        self._reward = REWARDS[reward]
        self._renderer: Any = None

    def _goals(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        points = self.arms.points.astype(np.float32).reshape(-1, 8)
        return points[:, :4], points[:, 4:]

    def _flags_and_registers(self) -> NDArray[np.float32]:
        seen = np.empty((self.arms.rows, 4 + len(MOTORS)), np.float32)
        seen[:, :4] = self.arms.visible
        seen[:, 4:] = self.arms.registers
        return seen

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The reward (...) for sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        return self._reward(distances, reach.rendezvous(distances, self.arms.tolerance))

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether a trial ends (...) at sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        ended = reach.rendezvous(distances, self.arms.tolerance)
        return ended if self._ends else np.zeros_like(ended)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """False: no goal cuts a trial short; the number of motions does (see `max_episode_steps`)."""
        return np.zeros(np.shape(achieved_goal)[:-1], bool)

    def _truth(self) -> dict[str, Any]:
        gripper, object_ = self.arms.simulation.positions()
        apart = gripper - object_
        return {
            "error_px": self.arms.error_px(),
            "distance_mm": 1000.0 * np.sqrt((apart * apart).sum(-1)),
            "points": self.arms.true_points.reshape(-1, 8),
            "gripper": gripper,
            "object": object_,
            "joints": self.arms.simulation.joints(),
        }

    def _frame(self, row: int) -> NDArray[np.uint8]:
        if self._renderer is None:
            from calfree_gym.rendering import SceneRenderer

            self._renderer = SceneRenderer()
        frame: NDArray[np.uint8] = self._renderer.draw(self.arms, row)
        return frame

    def _free_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def placed_objects(options: dict[str, Any] | None, rows: int) -> NDArray[np.float64] | None:
    """The object of reset's options (rows, 3) in m, where one is given."""
    if not options:
        return None
    if unknown := sorted(options.keys() - {"object"}):
        raise ValueError(f"reset has no option {', '.join(map(repr, unknown))}; allowed: 'object'")
    position = np.asarray(options["object"], np.float64)
    if position.shape not in ((3,), (rows, 3)) or not np.isfinite(position).all():
        raise ValueError(f"options['object'] is {options['object']!r}; it must be (x, y, z) in metres")
    return np.broadcast_to(position, (rows, 3))
