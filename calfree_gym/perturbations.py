"""Perturbations: functions from a world to a world, and schedules of when they strike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, Literal, get_args, get_type_hints

import numpy as np

from calfree_gym.geometry import quaternion_about, quaternion_product
from calfree_gym.motors import MOTORS
from calfree_gym.world import (
    CAMERAS,
    LINKS,
    MAX_LATENCY,
    World,
    log_uniform,
    near_misses,
    random_direction,
    wild_camera,
)

Camera = Literal["left", "right"]
Joint = Literal["J1", "J2", "J3", "J4"]
Link = Literal["base", "shoulder", "upper_arm", "forearm", "hand"]
Motor = Literal["waist", "shoulder", "elbow"]

JOINTS: tuple[Joint, ...] = get_args(Joint)
OPTICAL_AXIS = np.array([0.0, 0.0, -1.0])


class Perturbation:
    """A frozen value with `apply(world, rng) -> World`; what it is not given, it draws.

    Attributes:
        type: Its name in YAML.
    """

    type: ClassVar[str]

    def __post_init__(self) -> None:
        hints = get_type_hints(type(self))
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if value is not None:
                self._check(field.name, value, hints[field.name])

    def _check(self, name: str, value: object, hint: Any) -> None:
        choices = [c for option in get_args(hint) for c in get_args(option)]
        if choices:
            if value not in choices:
                raise ValueError(f"{self.type}.{name} is {value!r}; allowed: {', '.join(choices)}")
        elif isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{self.type}.{name} is {value!r}; it must be a number")
        elif not math.isfinite(value):
            raise ValueError(f"{self.type}.{name} is {value}; it must be finite")
        elif name in ("factor", "metres", "px") and (value < 0 or (name == "factor" and value == 0)):
            raise ValueError(f"{self.type}.{name} is {value}; it must be positive")
        elif name == "share" and not 0 <= value <= 1:
            raise ValueError(f"{self.type}.share is {value}; it must be in [0, 1]")
        elif name == "motions" and value not in range(MAX_LATENCY + 1):
            raise ValueError(f"{self.type}.motions is {value}; it must be whole, from 0 to {MAX_LATENCY}")

    def apply(self, world: World, rng: np.random.Generator) -> World:
        """Returns the perturbed world; `rng` draws what was not given."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """As in YAML: the type and what was given."""
        given = {k: v for k, v in asdict(self).items() if v is not None}  # type: ignore[call-overload]
        return {"type": self.type, **given}


def _pick(given: str | None, names: tuple[str, ...], rng: np.random.Generator) -> int:
    drawn = int(rng.integers(len(names)))
    return drawn if given is None else names.index(given)


def _given(value: float | None, drawn: float) -> float:
    return drawn if value is None else value


def _with(world: World, field: str, index: int, value: Any) -> World:
    array = getattr(world, field).copy()
    array[index] = value
    return replace(world, **{field: array})


def _turned(world: World, camera: int, axis: Any, degrees: float) -> World:
    turn = quaternion_about(axis, math.radians(degrees))
    turned = quaternion_product(world.camera_orientation[camera], turn)
    return _with(world, "camera_orientation", camera, turned)


@dataclass(frozen=True)
class CameraRoll(Perturbation):
    """Turns a camera about its optical axis by `degrees`, else by any angle."""

    type: ClassVar[str] = "camera_roll"
    camera: Camera | None = None
    degrees: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        camera = _pick(self.camera, CAMERAS, rng)
        return _turned(world, camera, OPTICAL_AXIS, _given(self.degrees, rng.uniform(-180, 180)))


@dataclass(frozen=True)
class CameraAim(Perturbation):
    """Turns a camera's viewing direction by `degrees` (else 3-15), towards `direction`.

    `direction` is the angle in degrees, from the image's x to its y axis, in which the view moves; else any.
    """

    type: ClassVar[str] = "camera_aim"
    camera: Camera | None = None
    degrees: float | None = None
    direction: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        camera = _pick(self.camera, CAMERAS, rng)
        degrees = _given(self.degrees, rng.uniform(3, 15))
        direction = math.radians(_given(self.direction, rng.uniform(-180, 180)))
        axis = np.array([-math.sin(direction), -math.cos(direction), 0.0])
        return _turned(world, camera, axis, degrees)


@dataclass(frozen=True)
class CameraZoom(Perturbation):
    """Multiplies a camera's focal length by `factor`, else by 0.8-1.25."""

    type: ClassVar[str] = "camera_zoom"
    camera: Camera | None = None
    factor: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        camera = _pick(self.camera, CAMERAS, rng)
        factor = _given(self.factor, log_uniform(rng, 0.8, 1.25))
        return _with(world, "focal_length", camera, world.focal_length[camera] * factor)


@dataclass(frozen=True)
class CameraShift(Perturbation):
    """Moves a camera, without turning it, by `metres` (else 0.02-0.10) in any direction."""

    type: ClassVar[str] = "camera_shift"
    camera: Camera | None = None
    metres: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        camera = _pick(self.camera, CAMERAS, rng)
        step = _given(self.metres, rng.uniform(0.02, 0.10)) * random_direction(rng)
        return _with(world, "camera_position", camera, world.camera_position[camera] + step)


@dataclass(frozen=True)
class CameraReplace(Perturbation):
    """Puts another camera, drawn as in wild worlds, in a camera's place."""

    type: ClassVar[str] = "camera_replace"
    camera: Camera | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        camera = _pick(self.camera, CAMERAS, rng)
        for field, value in wild_camera(rng, camera).items():
            world = _with(world, field, camera, value)
        return _with(world, "principal_point", camera, 0.0)


@dataclass(frozen=True)
class JointZero(Perturbation):
    """Shifts a joint's zero by `degrees`, else by up to 10 either way."""

    type: ClassVar[str] = "joint_zero"
    joint: Joint | None = None
    degrees: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        joint = _pick(self.joint, JOINTS, rng)
        shift = math.radians(_given(self.degrees, rng.uniform(-10, 10)))
        return _with(world, "joint_zeros", joint, world.joint_zeros[joint] + shift)


@dataclass(frozen=True)
class LinkLength(Perturbation):
    """Multiplies a link's length by `factor`, else by 0.9-1.1."""

    type: ClassVar[str] = "link_length"
    link: Link | None = None
    factor: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        link = _pick(self.link, LINKS, rng)
        factor = _given(self.factor, rng.uniform(0.9, 1.1))
        return _with(world, "link_lengths", link, world.link_lengths[link] * factor)


@dataclass(frozen=True)
class MotorGain(Perturbation):
    """Multiplies a motor's gain by `factor`, else by 0.67-1.5."""

    type: ClassVar[str] = "motor_gain"
    motor: Motor | None = None
    factor: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        motor = _pick(self.motor, MOTORS, rng)
        factor = _given(self.factor, log_uniform(rng, 0.67, 1.5))
        return _with(world, "motor_gain", motor, world.motor_gain[motor] * factor)


@dataclass(frozen=True)
class MotorSign(Perturbation):
    """Reverses a motor."""

    type: ClassVar[str] = "motor_sign"
    motor: Motor | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        motor = _pick(self.motor, MOTORS, rng)
        return _with(world, "motor_sign", motor, -world.motor_sign[motor])


@dataclass(frozen=True)
class PointNoise(Perturbation):
    """Sets the standard deviation of image coordinates to `px`, else to 0.5-5 pixels."""

    type: ClassVar[str] = "point_noise"
    px: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        return replace(world, point_noise=np.array(_given(self.px, log_uniform(rng, 0.5, 5))))


@dataclass(frozen=True)
class Lens(Perturbation):
    """Gives a camera's lens the radial distortion `k1`, else one within +-0.08."""

    type: ClassVar[str] = "lens"
    camera: Camera | None = None
    k1: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        camera = _pick(self.camera, CAMERAS, rng)
        return _with(world, "lens_k1", camera, _given(self.k1, rng.uniform(-0.08, 0.08)))


@dataclass(frozen=True)
class PointOutliers(Perturbation):
    """Makes a `share` of the image points stand anywhere in the image, else 0-0.4 of them."""

    type: ClassVar[str] = "point_outliers"
    share: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        return replace(world, point_outliers=np.array(_given(self.share, rng.uniform(0, 0.4))))


@dataclass(frozen=True)
class PointDropout(Perturbation):
    """Makes a `share` of the image points unseen, else 0-0.4 of them."""

    type: ClassVar[str] = "point_dropout"
    share: float | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        return replace(world, point_dropout=np.array(_given(self.share, rng.uniform(0, 0.4))))


@dataclass(frozen=True)
class Latency(Perturbation):
    """Makes image points come late by so many `motions`, else 1-3."""

    type: ClassVar[str] = "latency"
    motions: int | None = None

    def apply(self, world: World, rng: np.random.Generator) -> World:
        return replace(world, latency=np.array(_given(self.motions, int(rng.integers(1, 4)))))


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
    allowed = [field.name for field in fields(cls)]  # type: ignore[arg-type]
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
