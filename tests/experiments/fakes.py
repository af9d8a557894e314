"""A tiny environment and agent whose every trial is known beforehand."""

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np


class CountdownEnv(gymnasium.Env[Any, Any]):
    """The error, drawn at reset, is multiplied by the word; over at 4 px or after 10 motions."""

    tolerance_px = 4.0
    home_seconds = 2.5

    def __init__(self, perturb_motion: int | None = None, perturb_trial: int | None = None):
        self.action_space = gymnasium.spaces.Box(0, 1, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Box(0, 1, (1,), np.float32)
        self.world = SimpleNamespace(point_noise=0.5)
        self.motions = 0
        self.perturb_motion = perturb_motion
        self.perturb_trial = perturb_trial
        self.seeds: list[int | None] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._perturb(len(self.seeds) == self.perturb_trial)
        self.seeds.append(seed)
        self.error = float(self.np_random.uniform(20, 200))
        self.left = 10
        return self._observation(), {"truth": self._truth()}

    def step(self, action: Any) -> Any:
        self._perturb(self.motions == self.perturb_motion)
        self.motions += 1
        self.left -= 1
        self.error *= float(action[0])
        arrived = self.error <= self.tolerance_px
        info = {
            "truth": self._truth(),
            "robot_seconds": 1.5,
            "is_success": arrived,
        }
        return self._observation(), 0.0, arrived, self.left == 0, info

    def is_solved(self, truth: dict[str, Any]) -> bool:
        return bool(truth["error_px"] <= self.tolerance_px)

    def _perturb(self, due: bool) -> None:
        if due:
            self.world = SimpleNamespace(point_noise=0.5, shaken=True)
        self.applied = [Shake()] if due else []

    def _observation(self) -> Any:
        return np.array([self.error / 200], np.float32)

    def _truth(self) -> dict[str, float]:
        return {"error_px": self.error, "distance_mm": 2 * self.error}


class Shake:
    def to_dict(self) -> dict[str, Any]:
        return {"type": "shake", "degrees": 3.0}


class Halver:
    """Sends the same word always, and uses every global random number generator."""

    def __init__(self, word: float = 0.5):
        self.word = word
        self.states: list[Any] = []

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        np.random.random()  # noqa: NPY002
        self.states.append(state)
        return np.array([self.word], np.float32), (state or 0) + 1


class Repeater:
    """Learns nothing from trials in which it sends the same word always."""

    def __init__(self, env: gymnasium.Env[Any, Any]):
        self.env = env

    def learn(self, total_timesteps: int, callback: Any) -> None:
        self.env.reset()
        for _ in range(total_timesteps):
            _, _, terminated, truncated, _ = self.env.step(np.array([0.5], np.float32))
            if not callback(self):
                return
            if terminated or truncated:
                self.env.reset()
