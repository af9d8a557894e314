"""What training adds to the worlds as drawn, so that less is taken for granted: all of it in the images."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from calfree_gym.image import IMAGE_UNIT

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
