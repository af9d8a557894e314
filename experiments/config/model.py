"""What all parts of a configuration have in common."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer

from calfree_gym.errors import near_misses

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


class Model(BaseModel):
    """A frozen value that knows all its keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, ser_json_inf_nan="constants")


class WithoutUnused(Model):
    """One whose keys without a value are not written: a new key leaves the ids of runs as they are."""

    @model_serializer(mode="wrap")
    def _without_unused(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = written(self)
        return {key: value for key, value in values.items() if value is not None}


def one_of(found: str, allowed: tuple[str, ...]) -> str:
    """What was found, if it is allowed.

    Raises:
        ValueError: It is not; with near misses and all that is allowed.
    """
    if found in allowed:
        return found
    raise ValueError(f"unknown{near_misses(found, allowed)}; allowed: {', '.join(allowed)}")


def distinct(values: list[str], key: str) -> None:
    """Raises ValueError where a value stands twice."""
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"{key} {', '.join(twice)} stands twice; give each its own {key}")
