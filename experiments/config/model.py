"""What all parts of a configuration have in common."""

from collections.abc import Callable, Iterable
from typing import Annotated, Any, ClassVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
)

from calfree_gym.errors import near_misses

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=60)]
"""Three of them, and more, are the name of a folder, which has at most 255 letters."""


class Model(BaseModel):
    """A frozen value that knows all its keys.

    Attributes:
        later: Keys that are written only where they are used: so the ids of runs, and what older results say,
            stay as they were before there were these keys.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, ser_json_inf_nan="constants")
    later: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _without_unused(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = written(self)
        unused = {key for key in self.later if getattr(self, key) == type(self).model_fields[key].default}
        return {key: value for key, value in values.items() if key not in unused}


def one_of(found: str, allowed: tuple[str, ...]) -> str:
    """What was found; raises ValueError, with near misses and all that is allowed, where it is not."""
    if found in allowed:
        return found
    raise ValueError(f"unknown{near_misses(found, allowed)}; allowed: {', '.join(allowed)}")


def known(allowed: Callable[[], Iterable[str]]) -> AfterValidator:
    """Says of a key that its value is one of these; see `one_of`."""
    return AfterValidator(lambda found: one_of(found, tuple(allowed())))


def distinct(values: list[str], key: str) -> None:
    """Raises ValueError where a value stands twice."""
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"{key} {', '.join(twice)} stands twice; give each its own {key}")


def distinctly_named(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Raises ValueError where two have the same name; returns them."""
    distinct([each.name for each in values], "name")
    return values
