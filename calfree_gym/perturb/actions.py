"""What a robot whose motors are at fault executes of an action."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.world import World


def bounded(space: gym.Space[Any]) -> bool:
    """Whether an action is some numbers (m,), each in a range."""
    return isinstance(space, gym.spaces.Box) and len(space.shape) == 1 and space.is_bounded("both")


def middle(box: Any) -> Array:
    """The middle (m,) of the range of each number."""
    return np.asarray(box.low / 2.0 + box.high / 2.0)


def executed(action: Any, world: World, rest: Array, box: Any, spread: Array, normal: Array) -> Any:
    """The action (m,) that is executed; numbers whose motor is not at fault are as given, to the bit.

    In a box of whole numbers it is rounded. A number that has no range is nobody's fault.

    Args:
        action: As given (m,).
        world: Of which a word of 1 is half of a number's range.
        rest: Where the robot stays as it is (m,).
        box: The space of actions. An action outside of it may stay as far outside.
        spread: Standard deviation (m,), in words.
        normal: Standard normal numbers (m,).
    """
    half = box.high / 2.0 - box.low / 2.0
    at_fault = (half > 0) & (
        ((world.motor_sign * world.motor_gain) != 1)
        | (spread > 0)
        | (world.shortfall > 0)
        | (world.longest_motion < 1)
        | (world.dead_zone > 0)
    )
    if not at_fault.any():
        return action
    given, kind = np.asarray(action, float), np.asarray(action).dtype
    words = (given - rest) / np.where(at_fault, half, 1.0)
    words = np.where(np.abs(words) <= world.dead_zone, 0.0, words)
    longest = np.where(world.longest_motion < 1, world.longest_motion, np.inf)
    words = np.clip(words, -longest, longest) * (1 - world.shortfall)
    words = words * world.motor_sign * world.motor_gain + spread * normal
    there = np.clip(rest + half * words, np.minimum(box.low, given), np.maximum(box.high, given))
    there = np.where(at_fault, np.rint(there) if box.dtype.kind in "iu" else there, given)
    return there.astype(kind if kind.kind == "f" else box.dtype)
