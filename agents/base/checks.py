"""Checking what a knowledge base is given, with errors that say what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def check_whole(name: str, value: int, least: int) -> int:
    """Raises ValueError where a setting is no whole number, or less than its least."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(f"{name} is {value!r}; it must be a whole number, {least} or more")
    return value


def fitting(
    arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int | None, ...]
) -> NDArray[np.float64]:
    """A copy of the saved array `name`; raises ValueError where it is not of `shape` (None: any length)."""
    saved = arrays.get(name)
    if saved is None:
        raise ValueError(f"what was saved holds no {name}")
    fits = len(saved.shape) == len(shape) and all(
        wanted in (None, there) for there, wanted in zip(saved.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if length is None else str(length) for length in shape)
        raise ValueError(f"the saved {name} have shape {saved.shape}, here ({wanted}) is wanted")
    return np.array(saved, float)
