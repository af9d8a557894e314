"""Which world each row of an environment is in, or from which distribution it is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calfree_gym.world.distributions import WorldDistribution
from calfree_gym.world.value import World

WorldChoice = str | World | WorldDistribution | Mapping[str, Any]
"""A world, also as `World.to_dict` gives it, or a distribution of worlds or its name."""


def world_choices(world: Any, rows: int) -> list[World | WorldDistribution]:
    """One choice a row, from one for all of them or from a list.

    Raises:
        ValueError: The list has another length, or there is no such world.
    """
    if not isinstance(world, list | tuple):
        return [_choice(world)] * rows
    if len(world) != rows:
        raise ValueError(f"world is a list of {len(world)}; it must have {rows}, one an environment")
    return [_choice(each) for each in world]


def _choice(world: Any) -> World | WorldDistribution:
    if isinstance(world, World | WorldDistribution):
        return world
    return World.from_dict(world) if isinstance(world, Mapping) else WorldDistribution(world)
