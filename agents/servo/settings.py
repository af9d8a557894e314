"""Checking a servo's settings, with errors that say what is allowed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from calfree_gym.errors import near_misses


def check_one_of(servo: object, name: str, known: Iterable[str]) -> None:
    """Raises ValueError, with near misses, where the setting `name` is none of `known`."""
    value, known = getattr(servo, name), tuple(known)
    if value not in known:
        hint = near_misses(value, known)
        raise ValueError(f"{name} is {value!r}{hint}; allowed: {', '.join(known)}")


def check_numbers(servo: object, **least: float) -> None:
    """Raises ValueError where a setting is no finite number, or less than its least."""
    for name, bound in least.items():
        value = getattr(servo, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not bound <= value < np.inf:
            raise ValueError(f"{name} is {value!r}; it must be a number, {bound:g} or more")


def check_words(servo: object, *names: str) -> None:
    """Raises ValueError where a setting is larger than a control word can be."""
    for name in names:
        if (value := getattr(servo, name)) > 1:
            raise ValueError(f"{name} is {value!r}; words are at most 1")


def check_motions(servo: object) -> None:
    """Raises ValueError where a setting of test motions and steps, which all servos share, is not allowed."""
    check_numbers(servo, first_word=1e-6, test_px=1e-6, step_px=1e-6, step_word=1e-6)
    check_numbers(servo, damping=0.0, border=1e-6)
    check_words(servo, "first_word", "step_word")
