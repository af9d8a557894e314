"""Robots to train with: many wild worlds side by side, and how their image points follow their registers.

The environment is used as everybody can: a robot's twins, in the same world but with one register displaced,
give by finite differences what back-propagation through the black box needs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from torch import Tensor

from .weights import observation_format

DISPLACEMENT = 0.005
"""Of a twin's register (a guard): some 2 px, a thousand times what rounding to float32 hides."""
FAR = 3.0
"""True image points are cut to this many image units (a guard): a camera behind a point sees it anywhere."""
STEEPEST = 10.0
"""Derivatives of image points (image units a word) are cut to this (a guard): several times those in the work
space."""


class Look(NamedTuple):
    """What is observed of n robots with m motors, and what only a trainer knows of them.

    Attributes:
        points: Measured image points (n, 4, 2): gripper left, right, object left, right.
        visible: Which of them are seen now (n, 4).
        registers: Executed sums of words since home (n, m).
        true_points: Noise-free image points (n, 4, 2).
        derivatives: Of the true points by the registers (n, 4, 2, m).
    """

    points: Tensor
    visible: Tensor
    registers: Tensor
    true_points: Tensor
    derivatives: Tensor


class TrainingRobots:
    """Robots in worlds of their own, and their twins.

    Attributes:
        robots: n.
        motors: m.
        shapes: Of what they observe and are sent, see `observation_format`.

    Args:
        robots: n.
        mount: Where the cameras are fixed: "waist" or "stand".
        first_seed: Robot i lives in the world of seed first_seed + i.
    """

    def __init__(self, robots: int, mount: str, first_seed: int) -> None:
        self.robots = robots
        self._env = _kinematic(robots, mount)
        self.shapes = observation_format(self._env.single_observation_space, self._env.single_action_space)
        self.motors = self.shapes["words"][0]
        self._twins = _kinematic(robots * self.motors, mount)
        seeds = np.arange(first_seed, first_seed + robots)
        self._env.reset(seed=seeds.tolist())
        self._twins.reset(seed=np.repeat(seeds, self.motors).tolist())
        self._displaced = np.tile(DISPLACEMENT * np.eye(self.motors), (robots, 1))

    def begin(self) -> Look:
        """Sends all robots home and places the next objects."""
        observation, infos = self._env.reset()
        objects = np.repeat(infos["truth"]["object"], self.motors, 0)
        self._twins.reset(options={"object": objects})
        return self._look(observation, infos, self._displaced)

    def move(self, words: NDArray[Any]) -> Look:
        """Executes one motion of control words (n, m)."""
        observation, _, _, _, infos = self._env.step(words)
        return self._look(observation, infos, np.repeat(words, self.motors, 0))

    def _look(self, observation: dict[str, Any], infos: dict[str, Any], twin_words: NDArray[Any]) -> Look:
        _, _, _, _, twin_infos = self._twins.step(twin_words)
        true = infos["truth"]["points"]
        displaced = twin_infos["truth"]["points"].reshape(self.robots, self.motors, 8)
        slopes = np.clip((displaced - true[:, None]) / DISPLACEMENT, -STEEPEST, STEEPEST).swapaxes(1, 2)
        points = np.concatenate([observation["achieved_goal"], observation["desired_goal"]], 1)
        shape = (self.robots, 4, 2)
        return Look(
            points=torch.tensor(points).reshape(shape),
            visible=torch.tensor(observation["observation"][:, :4] > 0.5),
            registers=torch.tensor(observation["observation"][:, 4:]),
            true_points=torch.tensor(true.clip(-FAR, FAR), dtype=torch.float32).reshape(shape),
            derivatives=torch.tensor(slopes, dtype=torch.float32).reshape(*shape, self.motors),
        )


def _kinematic(robots: int, mount: str) -> Any:
    return gym.make_vec(
        "calfree_gym:CalFree/Reach-v0",
        num_envs=robots,
        world="wild",
        camera_mount=mount,
        dynamics="kinematic",
        terminate_on_success=False,
        max_episode_steps=2**31,
        autoreset_mode=AutoresetMode.DISABLED,
        threads=1,
    ).unwrapped
