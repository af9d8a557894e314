"""Perturbations: functions from a world to a world, and schedules of when they apply."""

from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import parse_schedule
from calfree_gym.perturbations.types import (
    TYPES,
    CameraAim,
    CameraReplace,
    CameraRoll,
    CameraShift,
    CameraZoom,
    JointZero,
    Lens,
    LinkLength,
    MotorGain,
    MotorSign,
    _Sensing,
    parse_perturbation,
)

__all__ = [
    "TYPES",
    "CameraAim",
    "CameraReplace",
    "CameraRoll",
    "CameraShift",
    "CameraZoom",
    "JointZero",
    "Lens",
    "LinkLength",
    "MotorGain",
    "MotorSign",
    "Perturbation",
    "_Sensing",
    "parse_perturbation",
    "parse_schedule",
]
