"""The interface of every knowledge base: from the object's sensor vector at home to registers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from agents.agent import Array


class Knowledge(Protocol):
    """Associations between sensor vectors (4,), seen from home, and registers (m,) that lead there."""

    def recall(self, sensors: Array) -> Array | None:
        """Registers (m,) that should bring the gripper to an object seen at `sensors`, if it knows."""

    def learn(self, sensors: Array, registers: Array) -> None:
        """Takes in that `registers` brought the gripper to an object seen at `sensors` from home."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
