"""Robots to train with: many wild worlds side by side, and how their image points follow their registers.

The environment is used as everybody can: a robot's twins, in the same world but with one register displaced,
give by finite differences what back-propagation through the black box needs.
"""

import math
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from torch import Tensor

from calfree_gym.image import IMAGE_UNIT

from .network import observation_format

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


CHANGED = 0.15
"""Share of the trials in which a camera turns, zooms or slips on the way. Choice, as all numbers
here."""
LAST_CHANGE = 8
"""The motion before which cameras have changed, where they do."""
ZOOM, SLIP = 0.25, 0.25
"""By how much: logarithm of the focal length's factor, and image units; a slip of 0.25 is a re-aim by 12°."""
NOISE_PX = 3.0
"""Up to so much noise is added to that of the world, in a third of the trials: those that it keeps from
ending weigh more than others."""
DROPOUT = 0.2
"""In a fifth of the trials, points are lost with a probability up to this."""


class Disturbances:
    """What befalls n robots in one trial.

    A roll and a zoom are exact as maps of image points; a re-aim is nearly a shift.

    Args:
        robots: n.
        motors: m.
        rng: Draws all that is drawn.
    """

    def __init__(self, robots: int, motors: int, rng: np.random.Generator) -> None:
        self._order = _tensor(np.argsort(rng.random((robots, motors)), 1), torch.long)
        self._back = torch.argsort(self._order, 1)
        self._sign = _tensor(rng.choice([-1.0, 1.0], (robots, motors)))
        self._noise = _tensor(_some(rng, 1 / 3, robots) * rng.uniform(0, NOISE_PX * IMAGE_UNIT, robots))
        self._dropout = _tensor(_some(rng, 0.2, robots) * rng.uniform(0, DROPOUT, robots))
        when = np.where(_some(rng, CHANGED, robots), rng.integers(1, LAST_CHANGE + 1, robots), -1)
        self._when = torch.tensor(when)
        angle = _some(rng, 0.6, (robots, 2)) * rng.uniform(-math.pi, math.pi, (robots, 2))
        factor = np.exp(_some(rng, 0.5, (robots, 2)) * rng.uniform(-ZOOM, ZOOM, (robots, 2)))
        cos, sin = factor * np.cos(angle), factor * np.sin(angle)
        self._new_map = _tensor(np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2))
        self._new_shift = _tensor(_some(rng, 0.5, (robots, 2, 1)) * rng.uniform(-SLIP, SLIP, (robots, 2, 2)))
        self._map = torch.eye(2).expand(robots, 2, 2, 2)
        self._shift = torch.zeros(robots, 2, 2)
        self._last = torch.zeros(robots, 4, 2)
        self._rng = rng

    def begin_motion(self, motion: int) -> None:
        """Changes the cameras that are due to change before this motion of the trial."""
        due = (self._when == motion)[:, None, None]
        self._map = torch.where(due[..., None], self._new_map, self._map)
        self._shift = torch.where(due, self._new_shift, self._shift)

    def in_images(self, points: Tensor) -> Tensor:
        """Where the cameras as they now are show image points (n, 4, 2)."""
        by_camera = points.view(-1, 2, 2, 2)
        mapped = torch.einsum("ncij,nwcj->nwci", self._map, by_camera) + self._shift[:, None]
        return mapped.reshape(points.shape)

    def measured(self, points: Tensor, visible: Tensor) -> tuple[Tensor, Tensor]:
        """Delivered points and flags: noise, dropout, and the border of the image; a lost point stays."""
        noise = _tensor(self._rng.standard_normal(points.shape, np.float32))
        noisy = self.in_images(points) + self._noise[:, None, None] * noise
        kept = _tensor(self._rng.random(visible.shape)) >= self._dropout[:, None]
        seen = visible & kept & (noisy.detach().abs().amax(-1) <= 1)
        self._last = torch.where(seen[:, :, None], noisy, self._last)
        return self._last, seen

    def to_network(self, registers: Tensor) -> Tensor:
        """Registers (n, m) in the order and with the signs that the network meets."""
        return registers.gather(1, self._order) * self._sign

    def to_robot(self, words: Tensor) -> Tensor:
        """The network's words (n, m) as the robot's motors get them."""
        return (words * self._sign).gather(1, self._back)


def _some(rng: np.random.Generator, share: float, shape: int | tuple[int, ...]) -> np.ndarray:
    return rng.random(shape) < share


def _tensor(values: np.ndarray, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.tensor(values, dtype=dtype)
