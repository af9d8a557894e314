"""Perturbations: functions from a world to a world, and schedules of when they are applied.

To add a perturbation:

1. Write a frozen dataclass, derived from `base.Perturbation`, in the module of what it changes: `camera`,
   `arm`, `wheels`, `image` or `occluder`. Its docstring says what it changes and what it draws for omitted
   settings; it becomes part of the documentation.
2. Give it `type`, its name in YAML, and one field per setting, made by `base.one_of`,
   `base.amount`, `base.factor` or `base.setting`.
3. Define `change(world, robot)`, which returns a new world; every setting is given there. For one entry of an
   array `base.with_entry` is enough.
4. Define `inverse()`, which returns the perturbation that undoes it. A perturbation that sets a value
   has none; define `drift(world, back, robot)` instead, which goes one step from the present value.
5. List the class here. The tests and the documentation then include it.

For example, in `arm`:

    @dataclass(frozen=True)
    class MotorCurvature(Perturbation):
        "Adds `by` (drawn: -0.1 to 0.1) to a motor's curvature."

        type: ClassVar[str] = "motor_curvature"
        motor: str = one_of("motors")
        by: float = amount(uniform(-0.1, 0.1))

        def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
            motor = robot.motors.index(self.motor)
            return with_entry(world, "motor_curvature", motor, world.motor_curvature[motor] + self.by)

        def inverse(self) -> Perturbation:
            return replace(self, by=-self.by)
"""

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
    CameraNearer,
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
from calfree_gym.perturbations.schedule import parse_schedule
from calfree_gym.perturbations.types import TYPES, parse_perturbation
from calfree_gym.perturbations.wheels import DockMoved, Slip, Track, WheelRadius

__all__ = [
    "TYPES",
    "Backlash",
    "Blur",
    "CameraAim",
    "CameraNearer",
    "CameraReplace",
    "CameraRoll",
    "CameraShift",
    "CameraZoom",
    "DeadZone",
    "DockMoved",
    "Exposure",
    "GearRipple",
    "ImageNoise",
    "JointZero",
    "Latency",
    "Lens",
    "Light",
    "LinkLength",
    "LongestMotion",
    "MotorGain",
    "MotorSign",
    "Occluder",
    "Perturbation",
    "PointDropout",
    "PointNoise",
    "PointOutliers",
    "RegisterNoise",
    "RegisterStep",
    "Repeatability",
    "Shortfall",
    "Slip",
    "Track",
    "WheelRadius",
    "parse_perturbation",
    "parse_schedule",
]
