"""Perturbations: functions from a world to a world, each a small tagged value."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from calfree_gym.geometry import quaternion_about, quaternion_product
from calfree_gym.motors import MOTORS
from calfree_gym.world import CAMERAS, LINKS, MAX_LATENCY, World, log_uniform, near_misses, wild_camera

JOINTS = ("J1", "J2", "J3", "J4")
_OPTICAL_AXIS = np.array([0.0, 0.0, -1.0])

Draw = Callable[[np.random.Generator], Any]


def _one_of(names: tuple[str, ...]) -> Any:
    """A setting that is one of some names; where it is not given, any of them."""
    draw: Draw = lambda rng: names[int(rng.integers(len(names)))]  # noqa: E731
    return field(default=None, metadata={"names": names, "draw": draw})


def _number(draw: Draw, least: float = -math.inf, most: float = math.inf, whole: bool = False) -> Any:
    """A setting that is a number within bounds; where it is not given, one that `draw` draws."""
    return field(default=None, metadata={"least": least, "most": most, "whole": whole, "draw": draw})


def _uniform(low: float, high: float) -> Draw:
    return lambda rng: float(rng.uniform(low, high))


def _factor(low: float, high: float) -> Any:
    """A positive factor; where it is not given, log-uniform within these bounds."""
    return _number(lambda rng: float(log_uniform(rng, low, high)), least=1e-3, most=1e3)


class Perturbation:
    """A frozen value that turns a world into another; what it is not given, it draws.

    Attributes:
        type: Its name in YAML.
    """

    type: ClassVar[str]

    def __post_init__(self) -> None:
        for setting in fields(self):  # type: ignore[arg-type]
            value = getattr(self, setting.name)
            if value is not None and (wrong := _wrong(value, setting.metadata)):
                raise ValueError(f"{self.type}.{setting.name} is {value!r}; {wrong}")

    def apply(self, world: World, rng: np.random.Generator) -> World:
        """Returns the perturbed world; `rng` draws what was not given."""
        return self.drawn(rng).change(world)

    def drawn(self, rng: np.random.Generator) -> Self:
        """The same with every setting given, those that were not drawn from `rng`."""
        draws = {s.name: s.metadata["draw"](rng) for s in fields(self)}  # type: ignore[arg-type]
        return replace(self, **(draws | self._given()))  # type: ignore[type-var]

    def change(self, world: World) -> World:
        """Returns the perturbed world, where every setting is given."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """As in YAML: the type and what was given."""
        return {"type": self.type, **self._given()}

    def _given(self) -> dict[str, Any]:
        return {k: v for k, v in asdict(self).items() if v is not None}  # type: ignore[call-overload]


def _wrong(value: Any, allowed: Mapping[str, Any]) -> str | None:
    """What is wrong with a setting's value, if anything."""
    if "names" in allowed:
        return None if value in allowed["names"] else f"allowed: {', '.join(allowed['names'])}"
    kind = "a whole number" if allowed["whole"] else "a number"
    if isinstance(value, bool) or not isinstance(value, int if allowed["whole"] else int | float):
        return f"it must be {kind}"
    if not math.isfinite(value):
        return "it must be finite"
    if not allowed["least"] <= value <= allowed["most"]:
        return f"it must be {kind} from {allowed['least']:g} to {allowed['most']:g}"
    return None


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
    camera: str = _one_of(CAMERAS)
    degrees: float = _number(_uniform(-180, 180))

    def change(self, world: World) -> World:
        return _turned(world, CAMERAS.index(self.camera), _OPTICAL_AXIS, self.degrees)


@dataclass(frozen=True)
class CameraAim(Perturbation):
    """Turns a camera's viewing direction by `degrees` (else 3-15), towards `direction`.

    `direction` is the angle in degrees, from the image's x to its y axis, in which the view moves; else any.
    """

    type: ClassVar[str] = "camera_aim"
    camera: str = _one_of(CAMERAS)
    degrees: float = _number(_uniform(3, 15))
    direction: float = _number(_uniform(-180, 180))

    def change(self, world: World) -> World:
        angle = math.radians(self.direction)
        axis = np.array([-math.sin(angle), -math.cos(angle), 0.0])
        return _turned(world, CAMERAS.index(self.camera), axis, self.degrees)


@dataclass(frozen=True)
class CameraZoom(Perturbation):
    """Multiplies a camera's focal length by `factor`, else by 0.8-1.25."""

    type: ClassVar[str] = "camera_zoom"
    camera: str = _one_of(CAMERAS)
    factor: float = _factor(0.8, 1.25)

    def change(self, world: World) -> World:
        camera = CAMERAS.index(self.camera)
        return _with(world, "focal_length", camera, world.focal_length[camera] * self.factor)


@dataclass(frozen=True)
class CameraShift(Perturbation):
    """Moves a camera, without turning it, by `metres` (else 0.02-0.10) in the direction given, else any.

    `azimuth` is in degrees from the mount's x axis to its y axis, `elevation` from the horizontal.
    """

    type: ClassVar[str] = "camera_shift"
    camera: str = _one_of(CAMERAS)
    metres: float = _number(_uniform(0.02, 0.10))
    azimuth: float = _number(_uniform(-180, 180))
    elevation: float = _number(lambda rng: math.degrees(math.asin(rng.uniform(-1, 1))), -90, 90)

    def change(self, world: World) -> World:
        camera = CAMERAS.index(self.camera)
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = math.cos(elevation)
        direction = [level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)]
        moved = world.camera_position[camera] + self.metres * np.array(direction)
        return _with(world, "camera_position", camera, moved)


@dataclass(frozen=True)
class CameraReplace(Perturbation):
    """Puts another camera, drawn as in wild worlds from `seed`, in a camera's place."""

    type: ClassVar[str] = "camera_replace"
    camera: str = _one_of(CAMERAS)
    seed: int = _number(lambda rng: int(rng.integers(2**31)), 0, 2**31, whole=True)

    def change(self, world: World) -> World:
        camera = CAMERAS.index(self.camera)
        for name, value in wild_camera(np.random.default_rng(self.seed), camera).items():
            world = _with(world, name, camera, value)
        return _with(world, "principal_point", camera, 0.0)


@dataclass(frozen=True)
class Lens(Perturbation):
    """Gives a camera's lens the radial distortion `k1`, else one within +-0.08."""

    type: ClassVar[str] = "lens"
    camera: str = _one_of(CAMERAS)
    k1: float = _number(_uniform(-0.08, 0.08), -0.5, 0.5)

    def change(self, world: World) -> World:
        return _with(world, "lens_k1", CAMERAS.index(self.camera), self.k1)


@dataclass(frozen=True)
class JointZero(Perturbation):
    """Shifts a joint's zero by `degrees`, else by up to 10 either way."""

    type: ClassVar[str] = "joint_zero"
    joint: str = _one_of(JOINTS)
    degrees: float = _number(_uniform(-10, 10))

    def change(self, world: World) -> World:
        joint = JOINTS.index(self.joint)
        return _with(world, "joint_zeros", joint, world.joint_zeros[joint] + math.radians(self.degrees))


@dataclass(frozen=True)
class LinkLength(Perturbation):
    """Multiplies a link's length by `factor`, else by 0.9-1.1."""

    type: ClassVar[str] = "link_length"
    link: str = _one_of(LINKS)
    factor: float = _factor(0.9, 1.1)

    def change(self, world: World) -> World:
        link = LINKS.index(self.link)
        return _with(world, "link_lengths", link, world.link_lengths[link] * self.factor)


@dataclass(frozen=True)
class MotorGain(Perturbation):
    """Multiplies a motor's gain by `factor`, else by 0.67-1.5."""

    type: ClassVar[str] = "motor_gain"
    motor: str = _one_of(MOTORS)
    factor: float = _factor(0.67, 1.5)

    def change(self, world: World) -> World:
        motor = MOTORS.index(self.motor)
        return _with(world, "motor_gain", motor, world.motor_gain[motor] * self.factor)


@dataclass(frozen=True)
class MotorSign(Perturbation):
    """Reverses a motor."""

    type: ClassVar[str] = "motor_sign"
    motor: str = _one_of(MOTORS)

    def change(self, world: World) -> World:
        motor = MOTORS.index(self.motor)
        return _with(world, "motor_sign", motor, -world.motor_sign[motor])


@dataclass(frozen=True)
class PointNoise(Perturbation):
    """Sets the standard deviation of image coordinates to `px`, else to 0.5-5 pixels."""

    type: ClassVar[str] = "point_noise"
    px: float = _number(lambda rng: float(log_uniform(rng, 0.5, 5)), least=0)

    def change(self, world: World) -> World:
        return replace(world, point_noise=np.array(self.px))


@dataclass(frozen=True)
class PointOutliers(Perturbation):
    """Makes a `share` of the image points stand anywhere in the image, else 0-0.4 of them."""

    type: ClassVar[str] = "point_outliers"
    share: float = _number(_uniform(0, 0.4), 0, 1)

    def change(self, world: World) -> World:
        return replace(world, point_outliers=np.array(self.share))


@dataclass(frozen=True)
class PointDropout(Perturbation):
    """Makes a `share` of the image points unseen, else 0-0.4 of them."""

    type: ClassVar[str] = "point_dropout"
    share: float = _number(_uniform(0, 0.4), 0, 1)

    def change(self, world: World) -> World:
        return replace(world, point_dropout=np.array(self.share))


@dataclass(frozen=True)
class Latency(Perturbation):
    """Makes image points come late by so many `motions`, else 1-3."""

    type: ClassVar[str] = "latency"
    motions: int = _number(lambda rng: int(rng.integers(1, 4)), 0, MAX_LATENCY, whole=True)

    def change(self, world: World) -> World:
        return replace(world, latency=np.array(self.motions))


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
