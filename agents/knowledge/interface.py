"""The interface of every knowledge base: from the object's sensor vector at home to registers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import NDArray

from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge


@dataclass(frozen=True)
class Recall:
    """What a knowledge base remembers of a place.

    Attributes:
        registers: Registers (m,) that should bring the gripper to the object.
        deviation_px: The confidence: standard deviation of where it ends up, in the worse image, in pixels.
    """

    registers: Array
    deviation_px: float


class Knowledge(Protocol):
    """Associations between sensor vectors (4,), seen from home, and registers (m,) that lead there."""

    @property
    def prior_knowledge(self) -> frozenset[PriorKnowledge]:
        """What it is built on, see `Agent`."""

    def recall(self, sensors: Array) -> Recall | None:
        """What is remembered of an object seen at `sensors` (4,), from home; None where nothing is."""

    def jacobian(self, registers: Array) -> Array | None:
        """∂sensors/∂registers (4, m) of an object at registers (m,); None where too little is known."""

    def learn(self, sensors: Array, registers: Array) -> None:
        """Takes in that `registers` (m,) bring the gripper to an object seen at `sensors` (4,) from home."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
