"""Checks of settings and of saved arrays, with errors that say what was found and what is allowed."""

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST = 2.0**53
"""Of what is saved. Derived: so far whole numbers are exact. What agents know is far less."""
ROUNDING = 1e-6
"""Of the numbers of a covariance, relative to the largest. Choice: that of float64 adds up over a life."""


def check_number(
    name: str,
    value: Any,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
    whole: bool = False,
    finite: bool = True,
) -> Any:
    """Returns a setting that is a number within its bounds.

    Args:
        name: Of the setting.
        value: As it was given.
        least: It must not be less.
        above: It must be greater.
        most: It must not be more.
        whole: Whether it must be a whole number.
        finite: Whether it must be finite.

    Raises:
        ValueError: It is none; says what is allowed.
    """
    right_kind = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    infinite = right_kind and not isinstance(value, Integral) and not math.isfinite(value)
    if right_kind and value > above and least <= value <= most and not (infinite and finite):
        return value
    kind = "a whole number" if whole else "a finite number" if infinite and finite else "a number"
    raise ValueError(f"{name} is {value!r}; it must be {', '.join([kind, *_bounds(least, above, most)])}")


def _bounds(least: float, above: float, most: float) -> list[str]:
    """In words."""
    bounds = [f"above {above:g}"] if above > -math.inf else []
    bounds += [f"{least:g} or more"] if least > -math.inf else []
    return bounds + ([f"at most {most:g}"] if most < math.inf else [])


def check_numbers(name: str, values: Any, **bounds: Any) -> list[Any]:
    """Returns a setting that is a list (or tuple) of numbers, each within the bounds of `check_number`.

    Raises:
        ValueError: It is none; says what is allowed.
    """
    if not isinstance(values, list | tuple):
        raise ValueError(f"{name} is {values!r}; it must be a list of numbers")
    return [check_number(name, value, **bounds) for value in values]


def checked_array(
    arrays: Mapping[str, NDArray[Any]],
    name: str,
    shape: tuple[int | None, ...],
    allow_nan: bool = False,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = MOST,
    whole: bool = False,
) -> NDArray[np.float64]:
    """A copy of the saved array `name`.

    Args:
        arrays: As they were saved.
        name: Of the array.
        shape: Its shape; None is any length.
        allow_nan: Whether numbers need not be finite; the bounds are of those that are.
        least: None must be less, nor less than -`most`.
        above: All must be greater.
        most: None must be more.
        whole: Whether they must be whole numbers.

    Raises:
        ValueError: There is none, it is of another shape, or holds what is no number, or none that is
            allowed; says which are.
    """
    saved = arrays.get(name)
    if saved is None:
        raise ValueError(f"what was saved holds no {name}")
    fits = len(saved.shape) == len(shape) and all(
        wanted in (None, there) for there, wanted in zip(saved.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if length is None else str(length) for length in shape)
        raise ValueError(f"the saved {name} have shape {saved.shape}, here ({wanted}) is wanted")
    if saved.dtype.kind not in "fiub":
        raise ValueError(f"the saved {name} are of type {saved.dtype}; they must be real numbers")
    array = np.array(saved, float)
    if not allow_nan and not np.isfinite(array).all():
        raise ValueError(f"the saved {name} hold numbers that are not finite")
    numbers, least = array[np.isfinite(array)], max(least, -most)
    wrong = (numbers < least) | (numbers <= above) | (numbers > most) | (whole & (numbers % 1 != 0))
    if wrong.any():
        kind = "whole numbers" if whole else "numbers"
        allowed = ", ".join([kind, *_bounds(least if least > above else -math.inf, above, most)])
        raise ValueError(f"the saved {name} hold {numbers[wrong][0]:g}; allowed: {allowed}")
    return array


def check_covariances(name: str, matrices: NDArray[np.float64]) -> None:
    """Raises ValueError where one of saved matrices (..., m, m) is, by more than rounding, no covariance."""
    rounding = ROUNDING * np.abs(matrices).max(initial=0.0)
    lopsided = np.abs(matrices - matrices.swapaxes(-1, -2)).max(initial=0.0) > rounding
    if lopsided or np.linalg.eigvalsh(matrices).min(initial=0.0) < -rounding:
        raise ValueError(f"the saved {name} are no covariances; allowed: symmetric, positive semidefinite")
