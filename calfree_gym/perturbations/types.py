"""Perturbations: functions from a world to a world, each a small tagged value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.geometry import quaternion_about, quaternion_between, quaternion_product
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.perturbations.base import SLOWNESS, Perturbation, amount, factor, one_of, setting, uniform
from calfree_gym.robot.motors import MOTORS
from calfree_gym.world import LINKS, MAX_LATENCY, World, log_uniform, wild_camera

JOINTS = ("J1", "J2", "J3", "J4")
_OPTICAL_AXIS = np.array([0.0, 0.0, -1.0])


def _with(world: World, name: str, index: int, value: Any) -> World:
    array = getattr(world, name).copy()
    array[index] = value
    return replace(world, **{name: array})


def _turned(world: World, camera: int, axis: Any, degrees: float) -> World:
    turn = quaternion_about(axis, math.radians(degrees))
    turned = quaternion_product(world.camera_orientation[camera], turn)
    return _with(world, "camera_orientation", camera, turned)


@dataclass(frozen=True)
class CameraRoll(Perturbation):
    """Turns a camera about its optical axis by `degrees`, else by any angle."""

    type: ClassVar[str] = "camera_roll"
    camera: str = one_of(CAMERAS)
    degrees: float = amount(uniform(-180, 180))

    def change(self, world: World) -> World:
        return _turned(world, CAMERAS.index(self.camera), _OPTICAL_AXIS, self.degrees)

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class CameraAim(Perturbation):
    """Turns a camera's viewing direction by `degrees` (else 3-15), towards `direction`.

    `direction` is the angle in degrees, from the image's x to its y axis, in which the view moves; else any.
    """

    type: ClassVar[str] = "camera_aim"
    camera: str = one_of(CAMERAS)
    degrees: float = amount(uniform(3, 15))
    direction: float = setting(uniform(-180, 180))

    def change(self, world: World) -> World:
        angle = math.radians(self.direction)
        axis = np.array([-math.sin(angle), -math.cos(angle), 0.0])
        return _turned(world, CAMERAS.index(self.camera), axis, self.degrees)

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class CameraZoom(Perturbation):
    """Multiplies a camera's focal length by `factor`, else by 0.8-1.25."""

    type: ClassVar[str] = "camera_zoom"
    camera: str = one_of(CAMERAS)
    factor: float = factor(0.8, 1.25)

    def change(self, world: World) -> World:
        camera = CAMERAS.index(self.camera)
        return _with(world, "focal_length", camera, world.focal_length[camera] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class CameraShift(Perturbation):
    """Moves a camera, without turning it, by `metres` (else 0.02-0.10) in the direction given, else any.

    `azimuth` is in degrees from the mount's x axis to its y axis, `elevation` from the horizontal.
    """

    type: ClassVar[str] = "camera_shift"
    camera: str = one_of(CAMERAS)
    metres: float = amount(uniform(0.02, 0.10))
    azimuth: float = setting(uniform(-180, 180))
    elevation: float = setting(lambda rng: math.degrees(math.asin(rng.uniform(-1, 1))), least=-90, most=90)

    def change(self, world: World) -> World:
        camera = CAMERAS.index(self.camera)
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = math.cos(elevation)
        direction = [level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)]
        moved = world.camera_position[camera] + self.metres * np.array(direction)
        return _with(world, "camera_position", camera, moved)

    def inverse(self) -> Perturbation:
        return replace(self, metres=-self.metres)


@dataclass(frozen=True)
class CameraReplace(Perturbation):
    """Puts another camera, drawn as in wild worlds from `seed`, in a camera's place.

    As a drift, the camera goes a hundredth of the way there in each step.
    """

    type: ClassVar[str] = "camera_replace"
    camera: str = one_of(CAMERAS)
    seed: int = setting(lambda rng: int(rng.integers(2**31)), least=0, most=2**31, whole=True)

    def change(self, world: World) -> World:
        return self._gone(world, 1.0)

    def drift(self, world: World, back: bool = False) -> World:
        return self._gone(world, -1 / (SLOWNESS - 1) if back else 1 / SLOWNESS)

    def _gone(self, world: World, share: float) -> World:
        """This share of the way to the other camera."""
        camera = CAMERAS.index(self.camera)
        other = wild_camera(np.random.default_rng(self.seed), camera)
        for name, value in {**other, "principal_point": np.zeros(2)}.items():
            present = getattr(world, name)[camera]
            if name == "camera_orientation":
                value = quaternion_between(present, value, share)
            elif share < 1:
                value = present + share * (value - present)
            world = _with(world, name, camera, value)
        return world


@dataclass(frozen=True)
class Lens(Perturbation):
    """Gives a camera's lens the radial distortion `k1`, else one within +-0.08; as a drift, adds it."""

    type: ClassVar[str] = "lens"
    camera: str = one_of(CAMERAS)
    k1: float = amount(uniform(-0.08, 0.08), least=-0.5, most=0.5)

    def change(self, world: World) -> World:
        return _with(world, "lens_k1", CAMERAS.index(self.camera), self.k1)

    def drift(self, world: World, back: bool = False) -> World:
        present = float(world.lens_k1[CAMERAS.index(self.camera)])
        return replace(self, k1=present + (-self.k1 if back else self.k1)).change(world)


@dataclass(frozen=True)
class JointZero(Perturbation):
    """Shifts a joint's zero by `degrees`, else by up to 10 either way."""

    type: ClassVar[str] = "joint_zero"
    joint: str = one_of(JOINTS)
    degrees: float = amount(uniform(-10, 10))

    def change(self, world: World) -> World:
        joint = JOINTS.index(self.joint)
        return _with(world, "joint_zeros", joint, world.joint_zeros[joint] + math.radians(self.degrees))

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class LinkLength(Perturbation):
    """Multiplies a link's length by `factor`, else by 0.9-1.1."""

    type: ClassVar[str] = "link_length"
    link: str = one_of(LINKS)
    factor: float = factor(0.9, 1.1)

    def change(self, world: World) -> World:
        link = LINKS.index(self.link)
        return _with(world, "link_lengths", link, world.link_lengths[link] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class MotorGain(Perturbation):
    """Multiplies a motor's gain by `factor`, else by 0.67-1.5."""

    type: ClassVar[str] = "motor_gain"
    motor: str = one_of(MOTORS)
    factor: float = factor(0.67, 1.5)

    def change(self, world: World) -> World:
        motor = MOTORS.index(self.motor)
        return _with(world, "motor_gain", motor, world.motor_gain[motor] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class MotorSign(Perturbation):
    """Reverses a motor."""

    type: ClassVar[str] = "motor_sign"
    motor: str = one_of(MOTORS)

    def change(self, world: World) -> World:
        motor = MOTORS.index(self.motor)
        return _with(world, "motor_sign", motor, -world.motor_sign[motor])

    def inverse(self) -> Perturbation:
        return self


class _Sensing(Perturbation):
    """Sets the quantity of sensing that its type names; as a drift, adds to it."""

    quantity: ClassVar[str]

    def change(self, world: World) -> World:
        return replace(world, **{self.type: np.array(getattr(self, self.quantity))})

    def drift(self, world: World, back: bool = False) -> World:
        step = getattr(self, self.quantity)
        there = getattr(world, self.type).item() + (-step if back else step)
        if self.settings()[self.quantity].whole:
            there = int(there)
        return replace(self, **{self.quantity: there}).change(world)  # type: ignore[type-var]


@dataclass(frozen=True)
class PointNoise(_Sensing):
    """Sets the standard deviation of image coordinates to `px`, else to 0.5-5 pixels; as a drift, adds."""

    type: ClassVar[str] = "point_noise"
    quantity: ClassVar[str] = "px"
    px: float = amount(lambda rng: float(log_uniform(rng, 0.5, 5)), least=0, most=IMAGE_SIZE)


@dataclass(frozen=True)
class PointOutliers(_Sensing):
    """Makes a `share` of the image points stand anywhere in the image, else 0-0.4; as a drift, adds."""

    type: ClassVar[str] = "point_outliers"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.4), least=0, most=1)


@dataclass(frozen=True)
class PointDropout(_Sensing):
    """Makes a `share` of the image points unseen, else 0-0.4 of them; as a drift, adds."""

    type: ClassVar[str] = "point_dropout"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.4), least=0, most=1)


@dataclass(frozen=True)
class Latency(_Sensing):
    """Makes image points come late by so many `motions`, else 1-3; as a drift, adds (else 1)."""

    type: ClassVar[str] = "latency"
    quantity: ClassVar[str] = "motions"
    motions: int = setting(
        lambda rng: int(rng.integers(1, 4)), least=0, most=MAX_LATENCY, whole=True, slow=lambda motions: 1
    )


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
        PointNoise,
        PointOutliers,
        PointDropout,
        Latency,
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
