"""`StereoArmVectorEnv` with the surface of a stable-baselines3 `VecEnv`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from calfree_gym.engine.vector import ArmVectorEnv, Row


class StereoArmVecEnv(VecEnv):
    """Arms whose next trial begins at once, as stable-baselines3 expects.

    An info holds `is_success`, and at a trial's end `terminal_observation` and `TimeLimit.truncated`.

    Args:
        envs: A batched environment that begins next trials in the step that ends one (SAME_STEP).

    Raises:
        ValueError: It begins them otherwise, is not CalFree's own, or its observations are wrapped.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        bare: Any = getattr(envs, "unwrapped", envs)
        if not isinstance(bare, ArmVectorEnv):
            raise ValueError(
                f"the batched environment is a {type(bare).__name__}; it must be CalFree's own, as "
                "make_vec makes it without vectorization_mode. Single environments go into a DummyVecEnv"
            )
        if envs.single_observation_space != bare.single_observation_space:
            raise ValueError("observations are wrapped; wrap them by a VecEnvWrapper of stable-baselines3's")
        mode = envs.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"the batched environment's autoreset_mode is {mode}; it must be SAME_STEP")
        self.vector_env: Any = envs
        self.render_mode = envs.render_mode
        space = envs.single_action_space
        self._actions: NDArray[Any] = np.zeros((envs.num_envs, *(space.shape or ())))
        super().__init__(envs.num_envs, envs.single_observation_space, space)

    def reset(self) -> VecEnvObs:
        """Begins a trial in every row; what `seed` and `set_options` gave counts here."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, infos = self.vector_env.reset(seed=seeds, options=self._options_of_rows())
        self.reset_infos = [{"is_success": bool(success)} for success in infos["is_success"]]
        self._reset_seeds()
        self._reset_options()
        return dict(observations)

    def _options_of_rows(self) -> dict[str, Any] | None:
        """What `set_options` gave, as the batched environment takes it."""
        first = self._options[0].keys()
        if any(each.keys() != first for each in self._options):
            raise ValueError(f"options are {self._options}; they must be of one kind in all rows, or empty")
        return {name: np.array([each[name] for each in self._options]) for name in first} or None

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the control words of the next motion."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Executes them."""
        observations, rewards, terminated, truncated, infos = self.vector_env.step(self._actions)
        dones = terminated | truncated
        success = infos["final_info"]["is_success"] if dones.any() else infos["is_success"]
        listed: list[dict[str, Any]] = [{"is_success": bool(s)} for s in success]
        for row in np.flatnonzero(dones):
            listed[row]["terminal_observation"] = infos["final_obs"][row]
            listed[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
        return dict(observations), rewards.astype(np.float32), dones, listed

    def close(self) -> None:
        """Closes the batched environment."""
        self.vector_env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One frame a row."""
        return self.vector_env.render() if self.render_mode else [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of each of the rows asked for."""
        found = self.vector_env.unwrapped.get_attr(attr_name)
        return [found[row] for row in self._rows(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets the `world` of the rows asked for; any other attribute for all rows.

        Raises:
            ValueError: Rows would differ in what they share.
        """
        envs, rows = self.vector_env.unwrapped, self._rows(indices)
        if attr_name == "world":
            for row in rows:
                envs.set_world(value, row)
            return
        values = list(envs.get_attr(attr_name)) if len(rows) < self.num_envs else [value] * self.num_envs
        for row in rows:
            values[row] = value
        envs.set_attr(attr_name, values)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method of each of the rows asked for."""
        envs = self.vector_env.unwrapped
        return [getattr(Row(envs, row), method_name)(*args, **kwargs) for row in self._rows(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """False for each row: rows have no wrappers."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
