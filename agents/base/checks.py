"""Checks of settings and of saved arrays, with errors that say what was found and what is allowed."""

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
    bounds = [f"above {above:g}"] if above > -math.inf else []
    bounds += [f"{least:g} or more"] if least > -math.inf else []
    bounds += [f"at most {most:g}"] if most < math.inf else []
    kind = "a whole number" if whole else "a finite number" if infinite and finite else "a number"
    raise ValueError(f"{name} is {value!r}; it must be {', '.join([kind, *bounds])}")


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
    most: float = math.inf,
) -> NDArray[np.float64]:
    """A copy of the saved array `name`.

    Raises:
        ValueError: There is none, it is not of `shape` (None: any length), or holds what is no number, a
            number that is not finite, or one of an absolute value above `most`.
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
    if (np.abs(array) > most).any():
        raise ValueError(
            f"the saved {name} hold {array[np.abs(array) > most][0]:g}; at most {most:g} is allowed"
        )
    return array
