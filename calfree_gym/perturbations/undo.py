"""Undoing what an event of a schedule has changed: for example, the old camera comes back."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from calfree_gym.world import World

_WHOLE = ("light_direction", "occluder")
"""Fields that have one value for all."""


@dataclass(frozen=True)
class Undo:
    """Restores what an earlier event changed.

    It is listed among the applied perturbations but is not one: a perturbation sees the present world alone,
    and that world does not know the old camera. In a world that was drawn or set since, it changes nothing.

    Attributes:
        event: The earlier one's place in the schedule, from 0.
    """

    type: ClassVar[str] = "undo"
    event: int

    def to_dict(self) -> dict[str, Any]:
        """As `Perturbation.to_dict`."""
        return {"type": self.type, "event": self.event}


def undone(world: World, before: World, after: World) -> World:
    """The world with all that differs between `before` and `after` restored; other quantities stay.

    The comparison is per camera, joint and motor: along the first axis of each field, but for lamp and
    occluder, which come back whole.
    """
    restored = {}
    for field in fields(World):
        old, new = getattr(before, field.name), getattr(after, field.name)
        differs = old != new
        if field.name in _WHOLE:
            differs = differs.any(keepdims=True)
        elif differs.ndim > 1:
            differs = differs.any(axis=-1, keepdims=True)
        if differs.any():
            restored[field.name] = np.where(differs, old, getattr(world, field.name))
    return replace(world, **restored)
