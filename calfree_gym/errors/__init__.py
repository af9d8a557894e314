"""Errors that name what was found and what is allowed."""

import difflib
import functools
import inspect
import math
import re
from collections.abc import Callable, Iterable
from numbers import Integral, Real
from typing import Any, ParamSpec

P = ParamSpec("P")


def near_misses(name: object, known: Iterable[str]) -> str:
    """A hint such as `" (did you mean wild?)"`, or nothing."""
    close = difflib.get_close_matches(str(name), list(known))
    return f" (did you mean {' or '.join(close)}?)" if close else ""


def printable(text: str) -> str:
    """A text without what a terminal would obey: names and logs are of whoever wrote them."""
    return re.sub(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", "\N{REPLACEMENT CHARACTER}", text)


def to_install(extra: str) -> str:
    """What to type for an extra of this project, which no package index has."""
    return f"pip install '.[{extra}]' in the repository of calfree"


def check_choice(name: str, value: object, allowed: Iterable[str]) -> None:
    """Raises ValueError, with near misses, where an argument is none of those allowed."""
    allowed = tuple(allowed)
    if value not in allowed:
        raise ValueError(f"{name} is {value!r}{near_misses(value, allowed)}; allowed: {', '.join(allowed)}")


def check_flag(name: str, value: object) -> None:
    """Raises ValueError where an argument is neither True nor False."""
    if not isinstance(value, bool):
        raise ValueError(f"{name} is {value!r}; allowed: True, False")


def check_whole(name: str, value: object, least: int, most: int, besides: str = "") -> None:
    """Raises ValueError, naming what is allowed `besides`, where an argument is no whole number within."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        raise ValueError(f"{name} is {value!r}; it must be a whole number from {least} to {most}{besides}")


def check_positive(name: str, value: Any, most: float = math.inf) -> None:
    """Raises ValueError where an argument is no number above 0, of at most `most`."""
    number = float(value) if not isinstance(value, bool) and isinstance(value, Real) else math.nan
    if not 0 < number <= most or number == math.inf:
        raise ValueError(
            f"{name} is {value!r}; it must be a number above 0{f', at most {most:g}' * (most < math.inf)}"
        )


def known_arguments(function: Callable[P, None]) -> Callable[P, None]:
    """Makes the TypeError at an unknown keyword name near misses, and those that are allowed.

    Gymnasium and TorchRL try keywords, and look for this type and Python's own words.
    """
    allowed = [name for name in inspect.signature(function).parameters if name != "self"]

    @functools.wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> None:
        for name in kwargs:
            if name not in allowed:
                hint = near_misses(name, allowed)
                found = f"{function.__qualname__}() got an unexpected keyword argument {name!r}"
                raise TypeError(f"{found}{hint}; allowed: {', '.join(allowed)}")
        function(*args, **kwargs)

    return checked
