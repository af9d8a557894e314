"""`--set key=value`: changing a configuration from the command line."""

from collections.abc import Iterable
from typing import Any

import yaml

from calfree_gym.errors.yaml_values import UnclearNumberError, read
from experiments.errors import ConfigError


def with_overrides(data: dict[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """A configuration's plain values with some of them replaced.

    Args:
        data: As read from YAML.
        overrides: Such as "worlds=2" or "scenarios.0.motions=200": the path as errors spell it, and a value
            as it would stand in YAML.

    Raises:
        ConfigError: An override is no key=value, its value no YAML, or its path leads nowhere.
    """
    for override in overrides:
        path, equals, text = override.partition("=")
        if not equals or not path:
            raise ConfigError(f"--set {override}: found no key=value; allowed: such as worlds=2")
        try:
            value = read(text)
        except UnclearNumberError as error:
            raise ConfigError(f"--set {override}: {error}") from None
        except (yaml.YAMLError, ValueError) as error:
            raise ConfigError(f"--set {override}: the value is not valid YAML: {error}") from None
        data = _replaced(data, path.split("."), value, override)
    return data


def _replaced(data: Any, path: list[str], value: Any, override: str) -> Any:
    if not path:
        return value
    key, *rest = path
    if isinstance(data, list):
        if not key.isdecimal() or int(key) >= len(data):
            raise ConfigError(f"--set {override}: found {key!r}; allowed: 0 to {len(data) - 1}")
        items = list(data)
        items[int(key)] = _replaced(items[int(key)], rest, value, override)
        return items
    if data is None or isinstance(data, dict):
        values = data or {}
        return {**values, key: _replaced(values.get(key), rest, value, override)}
    raise ConfigError(f"--set {override}: {key!r} leads into {data!r}, which has no keys")
