"""What all parts of a configuration have in common."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from calfree_gym.errors import near_misses

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


class Model(BaseModel):
    """A frozen value that knows all its keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, ser_json_inf_nan="constants")


def one_of(found: str, allowed: tuple[str, ...]) -> str:
    """What was found, if it is allowed.

    Raises:
        ValueError: It is not; with near misses and all that is allowed.
    """
    if found in allowed:
        return found
    raise ValueError(f"unknown{near_misses(found, allowed)}; allowed: {', '.join(allowed)}")


def distinct(values: list[str], key: str) -> None:
    """Raises ValueError where a value stands twice.

    Args:
        values: Of one key in the items of a list.
        key: For the message.
    """
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"{key} {', '.join(twice)} stands twice; give each its own {key}")
