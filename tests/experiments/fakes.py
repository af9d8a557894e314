"""A tiny environment and agent whose every trial is known beforehand, and runs of suites given as data."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np

from experiments.config.suite import Suite
from experiments.running import worker
from experiments.running.cpu_time import CpuTimes
from experiments.running.run import LifetimeRun, Run, runs_of

AIM = {"type": "camera_aim", "camera": "left", "degrees": 20}


def runs(data: dict[str, Any], **changes: Any) -> list[Run]:
    """The runs of a suite as it stands in YAML."""
    return runs_of(Suite.model_validate(data | changes))


def ids(data: dict[str, Any], **changes: Any) -> list[str]:
    return [run.id for run in runs(data, **changes)]


def lived(run: Run, folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Makes a run in this process; returns what it says about itself, and its rows."""
    if isinstance(run, LifetimeRun):
        outcome, _ = worker.run_lifetime(run, folder, CpuTimes())
    else:
        outcome = worker.run_sweep(run, folder, CpuTimes())
    return outcome, [json.loads(line) for line in (folder / "trials.jsonl").read_text().splitlines()]


def watched(recorder_class: Any, recorders: list[Any]) -> Any:
    """Makes recorders that keep the worlds that their agents meet; each is added to a list."""

    class Watched(recorder_class):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            recorders.append(self)
            self.worlds = [self.world]

        def step(self, action: Any) -> Any:
            result = super().step(action)
            if self.world != self.worlds[-1]:
                self.worlds.append(self.world)
            return result

    return Watched


DROPPED = object()


def spoil(data: Any, path: tuple[Any, ...], value: Any) -> None:
    """Replaces a value of a configuration, or drops its key."""
    *parents, last = path
    for key in parents:
        data = data[key]
    if value is DROPPED:
        del data[last]
    else:
        data[last] = value


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
