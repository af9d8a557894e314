"""FetchReach as images of two cameras, and a network that was shown the way in them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from calfree_gym.geometry import Array
from experiments.fetch_reach.cloned import demonstrations
from experiments.fetch_reach.environment import (
    BESIDE,
    CAMERA,
    FOVY,
    GRIPPER_AT_HOME,
    draw_goal,
    fetch,
    points_of,
)

SIZE = 64
"""Pixels along a side of an image."""
CELLS = SIZE // 2
"""Along a side of the map that a network makes of an image."""


class FetchImages(gym.ObservationWrapper[Any, Any, Any]):
    """What both cameras show (64, 64, 6), the goal as a red ball of 2 cm, and registers (3,)."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._model: Any = env.unwrapped.model  # type: ignore[attr-defined]
        self._renderer = mujoco.Renderer(self._model, SIZE, SIZE)
        self._cameras = CAMERA, self._beside()

    def observation(self, observation: Mapping[str, Array]) -> dict[str, Array]:
        """Images and registers, and the goal's image points (4,), which only teachers may tell."""
        draw_goal(self.env)
        made: Any = self.env.unwrapped
        images = []
        for camera in self._cameras:
            self._renderer.update_scene(made.data, camera)
            images.append(self._renderer.render())
        return {
            "images": np.concatenate(images, -1),
            "registers": observation["observation"][4:],
            "goal": observation["desired_goal"],
        }

    def close(self) -> None:
        """Closes the renderer, too."""
        self._renderer.close()
        super().close()

    def _beside(self) -> Any:
        """The camera that stands still, for MuJoCo's renderer."""
        self._model.vis.global_.fovy = FOVY
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        x, y, z = GRIPPER_AT_HOME - BESIDE
        camera.lookat[:], camera.distance = GRIPPER_AT_HOME, np.linalg.norm([x, y, z])
        camera.azimuth, camera.elevation = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        return camera


def images_of(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """As policies see it that go by images."""
    return FetchImages(points_of(env))


class ClonedFromImages:
    """A convolutional network that was shown the way in both images and by the registers, as built.

    Each camera has layers of its own, which end in a map of the image. Its mean place (spatial softmax,
    Levine et al. 2016) and the registers tell the words. That the map is to be brightest where the goal is,
    it was shown, too: the words alone do not teach so small a network to find a ball of a pixel.
    """

    CHANNELS, UNITS, EPOCHS, BATCH, RATE, SHARE = 8, 64, 40, 16, 6e-3, 0.1
    """Choice; the last one is how much the maps count beside the words."""

    def __init__(self, seed: int = 1) -> None:
        import torch

        observed, shown = demonstrations(images_of(fetch()), seed)
        torch.manual_seed(seed)
        channels, units = 2 * self.CHANNELS, self.UNITS
        self._maps = torch.nn.Sequential(
            *(torch.nn.Conv2d(6, channels, 5, stride=2, padding=2, groups=2), torch.nn.ReLU()),
            *(torch.nn.Conv2d(channels, channels, 3, padding=1, groups=2), torch.nn.ReLU()),
            torch.nn.Conv2d(channels, 2, 3, padding=1, groups=2),
        )
        self._head = torch.nn.Sequential(
            *(torch.nn.Linear(2 * 2 + 3, units), torch.nn.Tanh(), torch.nn.Linear(units, 3))
        )
        images, registers, goals = (
            torch.as_tensor(np.stack([each[key] for each in observed]))
            for key in ("images", "registers", "goal")
        )
        spread, words = shares_around(goals), torch.as_tensor(shown, dtype=torch.float32)
        optimizer = torch.optim.Adam([*self._maps.parameters(), *self._head.parameters()])
        batches = self.EPOCHS * len(words) // self.BATCH
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, self.RATE, batches)
        for _ in range(batches):
            some = torch.randint(len(words), (self.BATCH,))
            told, maps = self._tell(images[some], registers[some])
            of_maps = -(spread[some] * maps).sum(-1).mean()
            optimizer.zero_grad()
            (torch.nn.functional.mse_loss(told, words[some]) + self.SHARE * of_maps).backward()
            optimizer.step()
            schedule.step()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) as they would have been shown."""
        import torch

        images, registers = (torch.as_tensor(observation[key])[None] for key in ("images", "registers"))
        with torch.no_grad():
            words, _ = self._tell(images, registers)
        return np.clip(words[0].numpy(), -1, 1)

    def _tell(self, images: Any, registers: Any) -> tuple[Any, Any]:
        """Words (n, 3), and the logarithm of the share that each cell has of its map (n, 2, CELLS²).

        By images (n, 64, 64, 6) and registers (n, 3).
        """
        import torch

        maps = self._maps(images.permute(0, 3, 1, 2) / 255 - 0.5).flatten(2).log_softmax(-1)
        shares = maps.exp().unflatten(-1, (CELLS, CELLS))
        places = [shares.sum(2) @ _middles(), shares.sum(3) @ _middles()]
        return self._head(torch.cat([*places, registers], 1)), maps


def _middles() -> Any:
    """Of the cells along a side, in image units."""
    import torch

    return (torch.arange(CELLS) + 0.5) * 2 / CELLS - 1


def shares_around(points: Any) -> Any:
    """Shares of cells whose mean place is a point: of the four around it. From (n, 4) to (n, 2, CELLS²)."""
    near = (1 - (points.unflatten(1, (2, 2, 1)) - _middles()).abs() * CELLS / 2).clamp(min=0)
    columns, rows = near.unbind(2)
    return (rows[..., None] * columns[..., None, :]).flatten(2)
