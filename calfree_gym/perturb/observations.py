"""Leaves of nested observations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym

from calfree_gym.perturb.images import is_colour_image

Path = str | Sequence[str]
"""The key of a leaf, or keys one behind the other; none: the observation itself."""
Keys = tuple[str, ...]


def keys_of(name: str, path: Path) -> Keys:
    """The keys of a path; raises ValueError, with the name of what it is given for, where it is none."""
    if not isinstance(path, str | Sequence):
        raise ValueError(f"{name} is {path!r}; allowed: the key of a part of observations, or a list of keys")
    return (path,) if isinstance(path, str) else tuple(path)


def leaf(observation: Any, keys: Keys) -> Any:
    """What stands there, in an observation or in a space of them."""
    for key in keys:
        observation = observation[key]
    return observation


def with_leaf(observation: Any, keys: Keys, value: Any) -> Any:
    """The observation with another leaf; the given one stays as it is."""
    if not keys:
        return value
    first, *rest = keys
    return {**observation, first: with_leaf(observation[first], tuple(rest), value)}


def leaves(space: gym.Space[Any], keys: Keys = ()) -> dict[Keys, gym.Space[Any]]:
    """All leaves of a space, by their keys."""
    if not isinstance(space, gym.spaces.Dict):
        return {keys: space}
    return {path: each for key in space for path, each in leaves(space[key], (*keys, key)).items()}


def check_path(name: str, keys: Keys, space: gym.Space[Any]) -> None:
    """Raises ValueError, naming those that there are, where mappings of observations have no such part."""
    below: Any = space
    in_tuple = ""
    for key in keys:
        if isinstance(below, gym.spaces.Tuple):
            in_tuple = "; what is in a Tuple cannot be named: make it a Dict by a wrapper"
        below = below.spaces.get(key) if isinstance(below, gym.spaces.Dict) else None
    if below is None:
        known = ", ".join("/".join(path) for path in leaves(space) if path) or "no keys"
        named = "/".join(map(str, keys))
        raise ValueError(f"{name} names {named!r}, but observations have: {known}{in_tuple}")


def images_by_name(space: gym.Space[Any], cameras: tuple[str, ...]) -> dict[str, tuple[Keys, ...]]:
    """Images in observations that are called as a camera is: those of colours, where it has any."""
    found: dict[str, dict[Keys, bool]] = {}
    for path, each in leaves(space).items():
        if path and path[-1] in cameras and len(each.shape or ()) == 3:
            found.setdefault(path[-1], {})[path] = is_colour_image(each)
    return {
        name: tuple(path for path in paths if paths[path] or not any(paths.values()))
        for name, paths in found.items()
    }
