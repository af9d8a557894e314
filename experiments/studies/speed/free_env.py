"""An environment that costs nothing: what learning alone costs is measured on it."""

from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class FreeVecEnv(VecEnv):
    """Shows the same observation for ever, at reward 0; trials are cut off after 60 motions, row after row.

    They end because a learner works at the end of a trial, too.
    """

    TRIAL = 60

    def __init__(self, rows: int, observation_space: gym.Space[Any], action_space: gym.Space[Any]):
        assert isinstance(observation_space, gym.spaces.Dict)
        super().__init__(rows, observation_space, action_space)
        shapes = {key: (rows, *(space.shape or ())) for key, space in observation_space.items()}
        self._observation = {key: np.zeros(shape, np.float32) for key, shape in shapes.items()}
        self._first = {key: value[0] for key, value in self._observation.items()}
        self._motions = np.arange(rows)

    def reset(self) -> VecEnvObs:
        """See `VecEnv`."""
        return self._observation

    def step_async(self, actions: np.ndarray) -> None:
        """See `VecEnv`."""

    def step_wait(self) -> VecEnvStepReturn:
        """See `VecEnv`."""
        self._motions += 1
        over = self._motions % self.TRIAL == 0
        infos: list[dict[str, Any]] = [{} for _ in over]
        for row in np.flatnonzero(over):
            infos[row] = {"terminal_observation": self._first, "TimeLimit.truncated": True}
        return self._observation, np.zeros(self.num_envs, np.float32), over, infos

    def close(self) -> None:
        """See `VecEnv`."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """See `VecEnv`."""
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """See `VecEnv`."""

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """See `VecEnv`."""
        return [None] * self.num_envs

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """See `VecEnv`."""
        return [False] * self.num_envs
