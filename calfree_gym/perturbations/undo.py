"""Undoing what an event of a schedule has done: the old camera is put back."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from calfree_gym.world import World


@dataclass(frozen=True)
class Undo:
    """Makes what an earlier event changed what it was before that event.

    It is told where perturbations are, and is none: no function of the present world alone gives the old
    camera back.

    Attributes:
        event: The earlier one's place in the schedule, from 0.
    """

    type: ClassVar[str] = "undo"
    event: int

    def to_dict(self) -> dict[str, Any]:
        """As `Perturbation.to_dict`."""
        return {"type": self.type, "event": self.event}


def undone(world: World, before: World, after: World) -> World:
    """The world with all that differs between two others as it was `before`; what else has happened stays.

    It is told apart camera by camera, joint by joint and motor by motor, along the first axis of each field.
    """
    restored = {}
    for field in fields(World):
        old, new = getattr(before, field.name), getattr(after, field.name)
        differs = old != new
        if differs.ndim > 1:
            differs = differs.any(axis=-1, keepdims=True)
        if differs.any():
            restored[field.name] = np.where(differs, old, getattr(world, field.name))
    return replace(world, **restored)
