"""A world in which all objects lie in one region of the work space."""

from typing import Any

import gymnasium
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.robot.arms.movemaster import DISTANCE, HEIGHT, WAIST

LOW, HIGH = np.array([[-WAIST, DISTANCE[0], HEIGHT[0]], [WAIST, DISTANCE[1], HEIGHT[1]]])


class Region(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Resets until the object lies in a box about the first one, as far as that leaves the work space.

    The box is one in angle about the waist, distance from it and height: there the work space is a box too.

    Args:
        env: Places the objects.
        share: Of the work space's width, in each dimension.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], share: float):
        super().__init__(env)
        self._half = share / 2 * (HIGH - LOW)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Places an object in the region; with a seed, the region too."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._centre = np.clip(_place(info), LOW + self._half, HIGH - self._half)
        while (np.abs(_place(info) - self._centre) > self._half + 1e-9).any():
            observation, info = self.env.reset()
        return observation, info


def _place(info: dict[str, Any]) -> Array:
    """The object's angle (rad), distance and height (m)."""
    x, y, z = info["truth"]["object"]
    return np.array([np.arctan2(y, x), np.hypot(x, y), z])
