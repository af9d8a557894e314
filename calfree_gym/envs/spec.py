"""Arguments of an environment as plain values: JSON gives back the same environment."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from os import PathLike, fspath
from typing import Any

import numpy as np

from calfree_gym.world import WorldDistribution


def plain(value: Any) -> Any:
    """A value as numbers, text, lists and dicts, which environments take in its place.

    Worlds, arms, perturbations and events become the dicts of their `to_dict`.
    """
    if hasattr(value, "to_dict"):
        return plain(value.to_dict())
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, WorldDistribution):
        return value.name
    if isinstance(value, Enum):
        return value.value
    return fspath(value) if isinstance(value, PathLike) else value
