"""What goes in and out: control words as actions, the kinds of observations, and their spaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.envs.arms.privileged import PRIVILEGED
from calfree_gym.envs.arms.stereo_arms import StereoArms
from calfree_gym.image import CAMERAS
from calfree_gym.robot.arms.robot import Robot

Observation = dict[str, NDArray[Any]]
GOALS = ("points", "vision")
"""Observations of image points, which a goal environment has; `compute_reward` knows the reward by them."""
IMAGES = ("pixels", "rgb", "depth")
"""Observations of images."""
FARTHEST = 100.0
"""Bound of depths (m)."""


def observation_space(
    kind: str, image_size: int, tell: Sequence[str], robot: Robot, register_bound: float = 1.0
) -> spaces.Dict[Any]:
    """The observations of one arm.

    Args:
        kind: One of `GOALS` or `IMAGES`.
        image_size: Width and height in pixels of the images.
        tell: Names of privileged quantities, see `PRIVILEGED`.
        robot: The arm.
        register_bound: Of registers.
    """
    boxes: dict[str, spaces.Space[Any]] = {}
    registers, size = len(robot.motors), image_size
    if kind in GOALS:
        boxes |= {key: unit_box(4) for key in ("achieved_goal", "desired_goal")}
    elif kind == "pixels":
        boxes["pixels"] = pixel_box(size)
    elif kind == "rgb":
        boxes |= {f"{name}_image": spaces.Box(0, 255, (size, size, 3), np.uint8) for name in CAMERAS}
    else:
        boxes |= {f"{name}_depth": spaces.Box(0.0, FARTHEST, (size, size), np.float32) for name in CAMERAS}
    boxes["observation"] = state_box(4 * (kind in GOALS), registers, 0, register_bound)
    for name in tell:
        quantity = PRIVILEGED[name]
        bound = quantity.bound(robot, register_bound)
        boxes[name] = spaces.Box(-bound, bound, (quantity.size(robot),), np.float32)
    return spaces.Dict(boxes)


def unit_box(size: int) -> spaces.Box[Any]:
    """Numbers in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (size,), np.float32)


def state_box(before: int, registers: int, behind: int, register_bound: float) -> spaces.Box[Any]:
    """Registers within their bound; so many numbers in [-1, 1] before and behind them."""
    most = np.ones(before + registers + behind, np.float32)
    most[before : before + registers] = register_bound
    return spaces.Box(-most, most)


def pixel_box(size: int) -> spaces.Box[Any]:
    """Both images, left before right, of this width and height."""
    return spaces.Box(0, 255, (size, size, 6), np.uint8)


def pixels_of(stereo: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Both images of each row (N, 2, s, s, 3) as one (N, s, s, 6)."""
    return np.concatenate([stereo[:, 0], stereo[:, 1]], -1)


def joined(*parts: NDArray[Any]) -> NDArray[np.float32]:
    """Numbers (N, k) of all rows side by side, in single precision."""
    return np.concatenate(parts, 1, dtype=np.float32)


def observations(kind: str, tell: Sequence[str], arms: StereoArms) -> Observation:
    """What all rows deliver now, batched."""
    registers = arms.told_registers().astype(np.float32)
    points, visible, *images = arms.delivered
    observed: Observation
    if kind in GOALS:
        goals = points.astype(np.float32).reshape(-1, 8)
        state = np.concatenate([visible.astype(np.float32), registers], 1)
        observed = {"achieved_goal": goals[:, :4], "desired_goal": goals[:, 4:], "observation": state}
    else:
        (stereo,) = images
        if kind == "pixels":
            observed = {"pixels": pixels_of(stereo)}
        else:
            what = "image" if kind == "rgb" else "depth"
            delivered = np.minimum(stereo, FARTHEST) if kind == "depth" else stereo.copy()
            observed = {f"{name}_{what}": delivered[:, i] for i, name in enumerate(CAMERAS)}
        observed["observation"] = registers
    for name in tell:
        observed[name] = PRIVILEGED[name].of(arms).astype(np.float32)
    return observed


def action_space(motors: int) -> spaces.Box[Any]:
    """The control words of one arm."""
    return spaces.Box(-1.0, 1.0, (motors,), np.float32)


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
