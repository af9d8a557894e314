"""All perturbations by the names that they have in YAML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calfree_gym.errors import near_misses
from calfree_gym.perturbations.arm import (
    Backlash,
    DeadZone,
    GearRipple,
    JointZero,
    LinkLength,
    LongestMotion,
    MotorGain,
    MotorSign,
    RegisterNoise,
    RegisterStep,
    Repeatability,
    Shortfall,
)
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.camera import (
    CameraAim,
    CameraReplace,
    CameraRoll,
    CameraShift,
    CameraZoom,
    Lens,
)
from calfree_gym.perturbations.image import (
    Blur,
    Exposure,
    ImageNoise,
    Latency,
    Light,
    PointDropout,
    PointNoise,
    PointOutliers,
)
from calfree_gym.perturbations.occluder import Occluder

TYPES: dict[str, type[Perturbation]] = {
    cls.type: cls
    for cls in (
        CameraRoll,
        CameraAim,
        CameraZoom,
        CameraShift,
        CameraReplace,
        Lens,
        JointZero,
        LinkLength,
        MotorGain,
        MotorSign,
        Backlash,
        Repeatability,
        RegisterNoise,
        RegisterStep,
        Shortfall,
        LongestMotion,
        DeadZone,
        GearRipple,
        PointNoise,
        PointOutliers,
        PointDropout,
        Latency,
        Light,
        Exposure,
        Blur,
        ImageNoise,
        Occluder,
    )
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
