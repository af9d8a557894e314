"""What goes in and out: control words and reset's options, boxes of observations, goals and rewards."""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.image import lengths
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.workspace import check_near

Observation = dict[str, NDArray[Any]]
GOALS = ("points", "vision")
"""Observations of image points, which a goal environment has; `compute_reward` knows the reward by them."""
Floats = NDArray[Any]


def unit_box(size: int) -> spaces.Box[Any]:
    """Numbers in [-1, 1], such as the control words of one arm."""
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


def placed_objects(options: dict[str, Any] | None, rows: int, robot: Robot) -> NDArray[np.float64] | None:
    """The object of reset's options (rows, 3) in m, or None without one."""
    objects = given_option(options, "object", rows, "(x, y, z) in metres")
    if objects is not None:
        check_near(objects, robot)
    return objects


def given_option(
    options: dict[str, Any] | None, name: str, rows: int, what: str
) -> NDArray[np.float64] | None:
    """Three numbers a row (rows, 3) from the one option that reset has, or None without it.

    Args:
        options: As given.
        name: Of the option.
        rows: So many; one may be given for all.
        what: The numbers, as errors call them.

    Raises:
        ValueError: There is another option, or these are no such numbers.
    """
    options = checked_options(options)
    if unknown := sorted(options.keys() - {name}):
        raise ValueError(f"reset has no option {', '.join(map(repr, unknown))}; allowed: {name!r}")
    if not options:
        return None
    try:
        found = np.asarray(options[name], np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape not in ((3,), (rows, 3)) or not np.isfinite(found).all():
        raise ValueError(f"options[{name!r}] is {options[name]!r}; it must be {what}")
    return np.broadcast_to(found, (rows, 3))


def checked_options(options: Any) -> dict[str, Any]:
    """Reset's options, a copy; none where there are none.

    Raises:
        ValueError: They are no dict.
    """
    if options is not None and not isinstance(options, dict):
        raise ValueError(
            f"reset's options are {options!r}; they must be a dict, such as {{'object': (x, y, z)}}"
        )
    return dict(options or {})


def image_distances(achieved: Floats, desired: Floats) -> Floats:
    """Distances (..., k) in image units between the k image points of sensor vectors (..., 2 k)."""
    d = achieved - desired
    return lengths(d.reshape(*d.shape[:-1], d.shape[-1] // 2, 2))


def sparse_reward(distances: Floats, success: Floats) -> Floats:
    """0 at success and -1 anywhere else (...)."""
    return success - 1.0


def dense_reward(distances: Floats, success: Floats) -> Floats:
    """Minus the mean of the distances (...), in image units."""
    return -over_points(np.add, distances).astype(np.float64) / distances.shape[-1]


def over_points(combine: np.ufunc, distances: Floats) -> Floats:
    """Distances (..., k) combined to (...), ten times as fast as along the last axis."""
    return reduce(combine, (distances[..., i] for i in range(distances.shape[-1])))
