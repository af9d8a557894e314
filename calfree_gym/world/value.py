"""World: everything that the controller does not know, as one value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import lru_cache
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from calfree_gym.geometry import Array
from calfree_gym.robot.arms.robot import Robot

MAX_LATENCY = 10
"""In motions."""
MAX_TEXTURE = 2**31 - 1
MAX_SHORTFALL = 0.9
BUILT_LIGHT = np.array([-0.2, 0.45, -1.0]) / np.linalg.norm([-0.2, 0.45, -1.0])
"""Where the built robot's lamp shines."""


@dataclass(frozen=True, eq=False)
class World:
    """Cameras, arm, motors, measurement and light of one robot. Compares by value; arrays are read-only.

    The fields from `light_direction` on matter to rendered images alone, `occluder` where points can be
    hidden, and the last two where objects are grasped. Those from `backlash` to `gear_ripple` may be given as
    one value for all motors.

    Attributes:
        camera_position: Optical centres (2, 3) in m, left then right: in the room, with their mount where it
            is at home as built.
        camera_orientation: Quaternions (2, 4); a camera looks along its -z axis, y up.
        focal_length: In pixels of the 512-pixel image (2,).
        principal_point: Offset from the image centre in pixels (2, 2), x right, y down.
        lens_k1: Radial distortion (2,): a pinhole point at radius r from the axis, in focal lengths,
            appears at r * (1 + k1 * r**2).
        link_lengths: In m (l,), in the order of the arm's links.
        joint_zeros: True minus assumed position of the arm's joints, in rad or m (k,).
        motor_sign: +1 or -1 (m,), one a motor.
        motor_gain: Relative to the built robot's (m,), positive.
        motor_curvature: Of the map from register to position (m,), see `robot.motors`.
        point_noise: Standard deviation of an image coordinate in pixels ().
        point_outliers: Share of the points of an observation that stand anywhere in the image instead ().
        point_dropout: Share of the points of an observation that are not seen ().
        latency: Delay of image points and flags in motions (), a whole number.
        backlash: By how much a joint's position differs between both directions of motion, in rad or m (m,).
        repeatability: Standard deviation of a joint's position after a motion, in rad or m (m,).
        register_noise: Standard deviation of a register as delivered (m,), in registers.
        register_step: Delivered registers are whole multiples of it (m,); 0: exact.
        shortfall: Share of each word that is not executed (m,); registers tell what was.
        longest_motion: The largest word that one motion executes (m,); registers tell what was executed.
        word_gain: How many times as far a word moves the motor (m,): registers end at +-1 / word_gain.
        dead_zone: Words of at most this size (m,) leave the joint where it is; registers count them.
        gear_ripple: Period, phase in rad and depth (m, 3): along the register the motor's gain varies between
            1 - depth and 1 + depth, see `robot.motors`; periods are registers at a `word_gain` of 1.
        light_direction: Where the lamp shines (3,), of unit length, in the room.
        light_strength: How brightly it lights what faces it (), relative to white.
        light_ambient: How brightly all is lit from everywhere (), likewise.
        texture: Number of the pictures that cover table and room (), a whole number; 0: as built.
        exposure: Factor of each image's brightness (2,).
        blur: Standard deviation of each image's blur (2,), in pixels of 512.
        image_noise: Standard deviation of each image's noise (2,), in grey levels of 255.
        occluder: An upright cylinder that stands in the way (5,): its middle, its radius and half its height,
            in m, in the room; radius 0: none.
        object_mass: Of the things to be grasped, in kg ().
        object_friction: Coefficient of friction between them and the jaws ().
    """

    camera_position: Array
    camera_orientation: Array
    focal_length: Array
    principal_point: Array
    lens_k1: Array
    link_lengths: Array
    joint_zeros: Array
    motor_sign: Array
    motor_gain: Array
    motor_curvature: Array
    point_noise: Array
    point_outliers: Array = field(default_factory=lambda: np.zeros(()))
    point_dropout: Array = field(default_factory=lambda: np.zeros(()))
    latency: Array = field(default_factory=lambda: np.zeros(()))
    backlash: Array = field(default_factory=lambda: np.zeros(()))
    repeatability: Array = field(default_factory=lambda: np.zeros(()))
    register_noise: Array = field(default_factory=lambda: np.zeros(()))
    register_step: Array = field(default_factory=lambda: np.zeros(()))
    shortfall: Array = field(default_factory=lambda: np.zeros(()))
    longest_motion: Array = field(default_factory=lambda: np.ones(()))
    word_gain: Array = field(default_factory=lambda: np.ones(()))
    dead_zone: Array = field(default_factory=lambda: np.zeros(()))
    gear_ripple: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    light_direction: Array = field(default_factory=BUILT_LIGHT.copy)
    light_strength: Array = field(default_factory=lambda: np.array(0.6))
    light_ambient: Array = field(default_factory=lambda: np.array(0.5))
    texture: Array = field(default_factory=lambda: np.zeros(()))
    exposure: Array = field(default_factory=lambda: np.ones(2))
    blur: Array = field(default_factory=lambda: np.zeros(2))
    image_noise: Array = field(default_factory=lambda: np.full(2, 2.0))
    occluder: Array = field(default_factory=lambda: np.zeros(5))
    object_mass: Array = field(default_factory=lambda: np.array(0.15))
    object_friction: Array = field(default_factory=lambda: np.array(0.9))

    def __post_init__(self) -> None:
        values, motors = vars(self), np.size(self.motor_sign)
        for name, shape in _shapes(motors).items():
            try:
                array = np.array(values[name], np.float64)
            except (TypeError, ValueError):
                raise ValueError(f"World.{name} is {values[name]!r}; it must be numbers") from None
            array += 0.0  # no negative zero
            if array.shape != shape:
                array = _fitted(name, array, shape)
            array.setflags(write=False)
            values[name] = array
        least, most = _bounds(motors, len(self.joint_zeros), len(self.link_lengths))
        numbers = np.concatenate([values[name].ravel() for name in _SHAPES])
        if not ((numbers >= least) & (numbers <= most)).all():
            self._refuse()
        if (np.abs(self.motor_sign) != 1).any():
            raise ValueError(f"World.motor_sign {_RANGES['motor_sign'].told}, found {self.motor_sign}")
        for name in ("latency", "texture"):
            if getattr(self, name) % 1:
                raise ValueError(f"World.{name} {_RANGES[name].told}, found {getattr(self, name)}")
        for name in ("camera_orientation", "light_direction"):
            norms = np.linalg.norm(getattr(self, name), axis=-1)
            if (np.abs(norms - 1) > 1e-6).any():
                raise ValueError(f"World.{name} must have unit length, found {norms}")

    def _refuse(self) -> NoReturn:
        """Says which field is not finite, or out of its range."""
        for name in _SHAPES:
            if not np.isfinite(found := getattr(self, name)).all():
                raise ValueError(f"World.{name} must be finite, found {found.tolist()}")
        for name, (least, most, told) in _RANGES.items():
            found = getattr(self, name)
            if not ((found >= least) & (found <= most)).all():
                raise ValueError(f"World.{name} {told}, found {found.tolist()}")
        raise AssertionError

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, World):
            return NotImplemented
        return all(np.array_equal(getattr(self, f), getattr(other, f)) for f in _SHAPES)

    def __hash__(self) -> int:
        return hash(tuple(getattr(self, name).tobytes() for name in _SHAPES))

    def __reduce__(self) -> Any:
        return World.from_dict, (vars(self),)  # arrays stay read-only

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and floats under the names of the fields; `from_dict` gets them back exactly."""
        return {name: getattr(self, name).tolist() for name in _SHAPES}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> World:
        """The world that `to_dict` wrote; fields that have a default may be missing.

        Raises:
            ValueError: A field is missing, unknown, or of the wrong shape.
        """
        needed = {each.name for each in fields(cls) if each.default_factory is MISSING}
        if missing := sorted(needed - values.keys()):
            raise ValueError(f"a World lacks {', '.join(missing)}")
        if unknown := sorted(values.keys() - _SHAPES.keys()):
            raise ValueError(f"a World has no field {', '.join(unknown)}; it has {', '.join(_SHAPES)}")
        return cls(**values)

    @property
    def register_bound(self) -> float:
        """Registers are within +- this, and observation spaces within +-1 or more."""
        return max(1.0, float(1 / self.word_gain.min()))

    def check_fits(self, robot: Robot) -> None:
        """Raises where this is no world of that arm.

        Raises:
            ValueError: A field has another length; names what the arm has.
        """
        for name, what in (("motor_sign", "motors"), ("joint_zeros", "joints"), ("link_lengths", "links")):
            found, expected = len(getattr(self, name)), getattr(robot, what)
            if found != len(expected):
                raise ValueError(
                    f"World.{name} has shape ({found},); it must be ({len(expected)},): the arm's {what} are "
                    f"{', '.join(expected)}"
                )


_SHAPES: dict[str, tuple[int | str, ...]] = {
    "camera_position": (2, 3),
    "camera_orientation": (2, 4),
    "focal_length": (2,),
    "principal_point": (2, 2),
    "lens_k1": (2,),
    "link_lengths": ("l",),
    "joint_zeros": ("k",),
    "motor_sign": ("m",),
    "motor_gain": ("m",),
    "motor_curvature": ("m",),
    "point_noise": (),
    "point_outliers": (),
    "point_dropout": (),
    "latency": (),
    "backlash": ("m",),
    "repeatability": ("m",),
    "register_noise": ("m",),
    "register_step": ("m",),
    "shortfall": ("m",),
    "longest_motion": ("m",),
    "word_gain": ("m",),
    "dead_zone": ("m",),
    "gear_ripple": ("m", 3),
    "light_direction": (3,),
    "light_strength": (),
    "light_ambient": (),
    "texture": (),
    "exposure": (2,),
    "blur": (2,),
    "image_noise": (2,),
    "occluder": (5,),
    "object_mass": (),
    "object_friction": (),
}
_OF_ALL_MOTORS = (
    *("backlash", "repeatability", "register_noise", "register_step", "shortfall", "longest_motion"),
    *("word_gain", "dead_zone", "gear_ripple"),
)
"""Fields of which one value may be given for all motors."""


class _Range(NamedTuple):
    """Least and largest values of a field, and how errors tell them."""

    least: ArrayLike
    most: ArrayLike
    told: str


_LARGEST, _SMALLEST = np.finfo(float).max, np.nextafter(0.0, 1.0)
_FINITE = _Range(-_LARGEST, _LARGEST, "must be finite")
_POSITIVE = _Range(_SMALLEST, _LARGEST, "must be positive")
_NOT_NEGATIVE = _Range(0.0, _LARGEST, "must not be negative")
_RANGES = {
    "focal_length": _POSITIVE,
    "link_lengths": _POSITIVE,
    "motor_sign": _Range(-1.0, 1.0, "must be +1 or -1"),
    "motor_gain": _POSITIVE,
    "motor_curvature": _Range(-0.45, 0.45, "must be within +-0.45"),
    "point_noise": _NOT_NEGATIVE,
    "point_outliers": _Range(0.0, 1.0, "must be in [0, 1]"),
    "point_dropout": _Range(0.0, 1.0, "must be in [0, 1]"),
    "latency": _Range(0.0, MAX_LATENCY, f"must be a whole number from 0 to {MAX_LATENCY}"),
    "backlash": _NOT_NEGATIVE,
    "repeatability": _NOT_NEGATIVE,
    "register_noise": _NOT_NEGATIVE,
    "register_step": _NOT_NEGATIVE,
    "shortfall": _Range(0.0, MAX_SHORTFALL, f"must be in [0, {MAX_SHORTFALL:g}]"),
    "longest_motion": _Range(_SMALLEST, 1.0, "must be in (0, 1]"),
    "word_gain": _Range(1e-3, 1e3, "must be in [0.001, 1000]"),
    "dead_zone": _Range(0.0, 1.0, "must be in [0, 1]"),
    "gear_ripple": _Range(
        [1e-3, -_LARGEST, 0.0],
        [1e3, _LARGEST, np.nextafter(1.0, 0.0)],
        "must have periods (first) in [0.001, 1000] and depths (third) in [0, 1)",
    ),
    "light_strength": _NOT_NEGATIVE,
    "light_ambient": _NOT_NEGATIVE,
    "texture": _Range(0.0, MAX_TEXTURE, f"must be a whole number from 0 to {MAX_TEXTURE}"),
    "exposure": _POSITIVE,
    "blur": _NOT_NEGATIVE,
    "image_noise": _NOT_NEGATIVE,
    "occluder": _Range([*[-_LARGEST] * 3, 0.0, 0.0], _LARGEST, "has a negative radius or height"),
    "object_mass": _POSITIVE,
    "object_friction": _POSITIVE,
}


@lru_cache
def _shapes(motors: int) -> dict[str, tuple[int | str, ...]]:
    """Shapes of the fields with so many motors; letters stand for lengths that are free."""
    return {name: tuple(motors if n == "m" else n for n in shape) for name, shape in _SHAPES.items()}


@lru_cache
def _bounds(motors: int, joints: int, links: int) -> tuple[Array, Array]:
    """Least and largest values of all numbers of a world, field after field."""
    of: dict[int | str, int] = {"m": motors, "k": joints, "l": links}
    ends: tuple[list[Array], list[Array]] = [], []
    for name, shape in _SHAPES.items():
        least, most, _ = _RANGES.get(name, _FINITE)
        for found, end in zip(ends, (least, most), strict=True):
            found.append(
                np.broadcast_to(np.asarray(end, float), [of[n] if n in of else int(n) for n in shape]).ravel()
            )
    return np.concatenate(ends[0]), np.concatenate(ends[1])


def _fitted(name: str, array: Array, shape: tuple[int | str, ...]) -> Array:
    """A field in its shape, of which lengths may be free, or which one value for all motors may have.

    Raises:
        ValueError: It does not fit.
    """
    if name in _OF_ALL_MOTORS and array.shape == shape[1:]:
        filled = np.empty([int(n) for n in shape])
        filled[:] = array
        return filled
    fits = (free in ("k", "l", length) for free, length in zip(shape, array.shape, strict=False))
    if array.ndim != len(shape) or not all(fits):
        written = str(shape).replace("'", "")
        raise ValueError(f"World.{name} has shape {array.shape}; it must be {written}")
    return array
