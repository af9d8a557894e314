"""What agents that reach observe of anybody's robot: image points and registers, as in `CalFree/Reach-v0`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calfree_gym.image import lengths_px

Array = NDArray[Any]
SQUARE = ((1.0, 1.0), (1.0, 1.0))
"""Halves of the width and the height of both images, in image units, where they are square."""


def reaching_spaces(
    motors: int, edges: ArrayLike = SQUARE
) -> tuple[gym.spaces.Dict[Any], gym.spaces.Box[Any]]:
    """Spaces of observations and of control words.

    Args:
        motors: How many, m.
        edges: Halves (2, 2) of the width and the height of both images, in image units.
    """
    ends = np.ravel(edges).astype(np.float32)
    points = gym.spaces.Box(-ends, ends)
    state = gym.spaces.Box(-1.0, 1.0, (4 + motors,), np.float32)
    observed = gym.spaces.Dict(achieved_goal=points, desired_goal=points, observation=state)
    return observed, gym.spaces.Box(-1.0, 1.0, (motors,), np.float32)


def reaching_observation(
    points: Array, visible: Array, registers: Array, tolerance_px: float
) -> tuple[dict[str, Array], bool]:
    """The observation, and whether gripper and object are seen at one place in both images.

    Args:
        points: Image points (4, 2): gripper left and right, object left and right.
        visible: Which of them are seen now (4,).
        registers: Where motors stand (m,), within -1 to 1.
        tolerance_px: Of the rendezvous, where the longer side of an image is 512 px.
    """
    observation = {
        "achieved_goal": points[:2].ravel(),
        "desired_goal": points[2:].ravel(),
        "observation": np.concatenate([visible, registers]),
    }
    floats = {name: values.astype(np.float32) for name, values in observation.items()}
    return floats, bool(visible.all() and farthest_px(points) <= tolerance_px)


def farthest_px(points: Array) -> float:
    """The image distance of points (4, 2) in the worse camera."""
    return float(lengths_px(points[:2] - points[2:]).max())
