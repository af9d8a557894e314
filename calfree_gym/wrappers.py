"""Wrappers for learners: an action becomes a small control word, in one environment or in many."""

from __future__ import annotations

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


def _check(limit: float, curvature: float) -> None:
    if not 0 < limit <= 1 or not 0 < curvature < np.inf:
        raise ValueError(
            f"limit is {limit} and curvature is {curvature}; allowed: 0 < limit <= 1, finite curvature > 0"
        )


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
        ValueError: The limit is outside (0, 1], or the curvature is not positive.
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
