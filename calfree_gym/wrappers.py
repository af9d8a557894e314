"""Wrappers for learners: an action becomes a small control word, in one environment or in many."""

from __future__ import annotations

from numbers import Real
from sys import float_info
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorActionWrapper
from numpy.typing import NDArray


def scaled_words(actions: NDArray[Any], limit: float, curvature: float = 1.0) -> NDArray[np.float32]:
    """Control words limit * sign(a) * |a|**curvature (...) from actions a (...), clipped to [-1, 1]."""
    actions = np.clip(actions, -1.0, 1.0)
    return np.asarray(limit * np.sign(actions) * np.abs(actions) ** curvature, np.float32)


def _check(limit: object, curvature: object) -> None:
    for name, value, most, allowed in (
        ("limit", limit, 1.0, "0 < limit <= 1"),
        ("curvature", curvature, float_info.max, "finite curvature > 0"),
    ):
        if isinstance(value, bool) or not isinstance(value, Real) or not 0 < float(value) <= most:
            raise ValueError(f"{name} is {value!r}; allowed: {allowed}")


class ScaledWords(gym.ActionWrapper[Any, Any, Any], RecordConstructorArgs):
    """Bounds control words: an action a in [-1, 1] becomes the word limit * sign(a) * |a|**curvature.

    A word of 1 moves a motor from home to its farther stop or beyond. Learners that explore the whole range
    of their actions (SAC, TD3) learn small corrections only when their words are bounded. The space of
    actions stays [-1, 1]. `make_sb3_env(word_limit=...)` does the same for many arms.

    Args:
        env: One environment.
        limit: The largest word.
        curvature: Above 1, small words get finer.

    Raises:
        ValueError: The limit is no number in (0, 1], or the curvature none that is finite and positive.
    """

    def __init__(self, env: gym.Env[Any, Any], limit: float = 0.25, curvature: float = 1.0) -> None:
        _check(limit, curvature)
        RecordConstructorArgs.__init__(self, limit=limit, curvature=curvature)
        gym.ActionWrapper.__init__(self, env)
        self.limit, self.curvature = limit, curvature

    def action(self, action: NDArray[Any]) -> NDArray[np.float32]:
        """Control words (motors,) from a learner's action."""
        return scaled_words(action, self.limit, self.curvature)


class VectorScaledWords(VectorActionWrapper):
    """`ScaledWords` for a batched environment, in any autoreset mode."""

    def __init__(
        self, env: gym.vector.VectorEnv[Any, Any, Any], limit: float = 0.25, curvature: float = 1.0
    ) -> None:
        _check(limit, curvature)
        super().__init__(env)
        self.limit, self.curvature = limit, curvature

    def actions(self, actions: NDArray[Any]) -> NDArray[np.float32]:
        """Control words (n, motors) from a learner's actions."""
        return scaled_words(actions, self.limit, self.curvature)
