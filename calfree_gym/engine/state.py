"""The states of rows, between which planners go back and forth, and from which copies go on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

from calfree_gym.robot.arms.robot import Mounts, Robot

RowState = Mapping[str, Any]
"""Numbers, arrays and frozen values of one row; it shares nothing with the environment that it came from."""


class HasState(Protocol):
    """A part of N rows.

    Attributes:
        state_names: Names of the arrays and lists whose entries, one a row, are its state.
    """

    state_names: ClassVar[tuple[str, ...]]


def state_of(part: HasState, row: int) -> dict[str, Any]:
    """The state of a row of a part."""
    return {name: _own(getattr(part, name)[row]) for name in part.state_names}


def restore(part: HasState, row: int, state: RowState) -> None:
    """Brings a row of a part into a state that `state_of` gave."""
    for name in part.state_names:
        getattr(part, name)[row] = _own(state[name])


def _own(value: Any) -> Any:
    return value.copy() if hasattr(value, "copy") else value


def arm_state(robot: Robot, mounts: Mounts) -> dict[str, Any]:
    """By what the state of an arm is told from that of another."""
    links = dict(zip(robot.links, robot.lengths.tolist(), strict=True))
    return {"motors": robot.motors, "links": links, "camera mounts": mounts}


def check_state(state: RowState, robot: Robot, mounts: Mounts, parts: Sequence[str]) -> None:
    """Raises where something is no state of a row with this arm, or has not all of its parts.

    Raises:
        ValueError: It is none, or that of another arm; says what was found and what is allowed.
    """
    if not isinstance(state, Mapping) or not {"arm", *parts} <= state.keys():
        found = repr(state)
        raise ValueError(
            f"the state is {found[:100] + '...' * (len(found) > 100)}; it must be what get_state() gave"
        )
    for name, here in arm_state(robot, mounts).items():
        if (there := state["arm"].get(name)) != here:
            raise ValueError(f"the state is of another arm: its {name} are {there}; here they are {here}")


def check_fits(part: HasState, row: int, state: RowState, prefix: str = "") -> None:
    """Raises where a state is not that of such a part of a row.

    Args:
        part: The part.
        row: The row.
        state: Its state.
        prefix: Of the names that errors tell.

    Raises:
        ValueError: An entry is missing, or of another shape; says which.
    """
    for name in part.state_names:
        if name not in state:
            raise ValueError(f"the state has no {prefix}{name}: its environment observes something else")
        found, here = (getattr(each, "shape", ()) for each in (state[name], getattr(part, name)[row]))
        if found != here:
            raise ValueError(f"the state's {prefix}{name} has shape {found}; it must have {here}")
