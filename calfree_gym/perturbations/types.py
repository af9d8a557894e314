"""All perturbations by the names that they have in YAML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calfree_gym.errors import near_misses
from calfree_gym.perturbations import arm, camera, image, occluder, wheels
from calfree_gym.perturbations.base import Perturbation

TYPES: dict[str, type[Perturbation]] = {
    cls.type: cls
    for module in (camera, arm, wheels, image, occluder)
    for cls in vars(module).values()
    if isinstance(cls, type) and issubclass(cls, Perturbation) and "type" in vars(cls)
}


def parse_perturbation(value: Mapping[str, Any], where: str = "perturbation") -> Perturbation:
    """The perturbation that a dict such as `{"type": "camera_roll", "degrees": 30}` names.

    Raises:
        ValueError: An unknown type or key, or a value that is not allowed; says where.
    """
    if not isinstance(value, Mapping) or "type" not in value:
        raise ValueError(f"{where} is {value!r}; it must be a mapping with a type")
    cls = TYPES.get(str(value["type"]))
    if cls is None:
        raise ValueError(
            f"{where}.type is {value['type']!r}{near_misses(value['type'], TYPES)}; "
            f"allowed: {', '.join(TYPES)}"
        )
    allowed = cls.settings()
    given = {k: v for k, v in value.items() if k != "type"}
    for name in given:
        if name not in allowed:
            raise ValueError(
                f"{where} has {name!r}{near_misses(name, allowed)}; "
                f"{cls.type} allows: {', '.join(allowed) or 'nothing else'}"
            )
    try:
        return cls(**given)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
