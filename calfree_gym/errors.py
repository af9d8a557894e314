"""Errors that name what was found and what is allowed."""

import difflib
from collections.abc import Iterable


def near_misses(name: object, known: Iterable[str]) -> str:
    """A hint such as `" (did you mean wild?)"`, or nothing."""
    close = difflib.get_close_matches(str(name), list(known))
    return f" (did you mean {' or '.join(close)}?)" if close else ""


def check_choice(name: str, value: object, allowed: tuple[str, ...]) -> None:
    """Raises ValueError, with near misses, where an argument is none of those allowed."""
    if value not in allowed:
        raise ValueError(
            f"unknown {name} {value!r}{near_misses(value, allowed)}; allowed: {', '.join(allowed)}"
        )
