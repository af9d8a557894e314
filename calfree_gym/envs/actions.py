"""Control words as actions."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.robot.arms.robot import Robot


def action_space(robot: Robot) -> spaces.Box[Any]:
    """The control words of one arm."""
    return spaces.Box(-1.0, 1.0, (len(robot.motors),), np.float32)


def control_words(action: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Control words from an action, clipped to [-1, 1].

    Raises:
        ValueError: The action has another shape, or is not finite.
    """
    try:
        words = np.asarray(action, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"the action is {action!r}; it must be numbers of shape {shape}") from None
    if words.shape != shape:
        raise ValueError(f"the action has shape {words.shape}; it must be {shape}, one word a motor")
    if np.maximum.reduce(np.abs(words), axis=None) <= 1:
        return words
    if not np.isfinite(words).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(words))[0])
        raise ValueError(f"the action at {where} is {words[where]}; control words must be finite, in [-1, 1]")
    return np.clip(words, -1.0, 1.0)
