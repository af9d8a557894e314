"""World: everything that the controller does not know, as one value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
MAX_SLIP = 0.3
MAX_COUPLING = 0.4
"""From 0.5 on, a motor could go with the next joint more than with its own."""
BUILT_LIGHT = np.array([-0.2, 0.45, -1.0]) / np.linalg.norm([-0.2, 0.45, -1.0])
"""Where the built robot's lamp shines."""


@dataclass(frozen=True, eq=False)
class World:
    """Cameras, arm, motors, measurement and light of one robot. Compares by value; arrays are read-only.

    The fields from `light_direction` on matter to rendered images alone, `occluder` where points can be
    hidden, `object_mass` and `object_friction` where objects are grasped, and the last three where a base
    docks. Those from `backlash` to `motor_coupling` may be given
    as one value for all motors; `lens_k2`, `pixel_aspect` and those from `exposure` to `image_noise` as one
    for all cameras.

    Attributes:
        camera_position: Optical centres (c, 3) in m, in the order of the robot's cameras: in the room, with
            their mount where it is at home as built.
        camera_orientation: Quaternions (c, 4); a camera looks along its -z axis, y up.
        focal_length: In pixels of the 512-pixel image, along x (c,).
        principal_point: Offset from the image centre in pixels (c, 2), x right, y down.
        lens_k1: Radial distortion (c,): a pinhole point at radius r from the axis, in focal lengths,
            appears at r * (1 + k1 * r**2 + k2 * r**4).
        lens_k2: See `lens_k1` (c,).
        pixel_aspect: Width of a pixel over its height (c,): the focal length along y is so many times that
            along x.
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
        motor_coupling: Share of its register by which a motor goes with the shaft of the next one, and the
            last with that of the first (m,), see `robot.motors`.
        light_direction: Where the lamp shines (3,), of unit length, in the room.
        light_strength: How brightly it lights what faces it (), relative to white.
        light_ambient: How brightly all is lit from everywhere (), likewise.
        texture: Number of the pictures that cover table and room (), a whole number; 0: as built.
        exposure: Factor of each image's brightness (c,).
        blur: Standard deviation of each image's blur (c,), in pixels of 512.
        image_noise: Standard deviation of each image's noise (c,), in grey levels of 255.
        occluder: An upright cylinder that stands in the way (5,): its middle, its radius and half its height,
            in m, in the room; radius 0: none.
        object_mass: Of the things to be grasped, in kg ().
        object_friction: Coefficient of friction between them and the jaws ().
        marks: On the front of a mobile base, in its frame, in m (d, 3); those of its dock stand alike in the
            dock's frame. None: it is no base, and the fields below mean nothing.
        dock: Where the dock is in the room (3,): x and y in m, heading in rad.
        slip: Standard deviation of a wheel's way in a motion, as a share of it ().
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
    motor_coupling: Array = field(default_factory=lambda: np.zeros(()))
    lens_k2: Array = field(default_factory=lambda: np.zeros(()))
    pixel_aspect: Array = field(default_factory=lambda: np.ones(()))
    light_direction: Array = field(default_factory=BUILT_LIGHT.copy)
    light_strength: Array = field(default_factory=lambda: np.array(0.6))
    light_ambient: Array = field(default_factory=lambda: np.array(0.5))
    texture: Array = field(default_factory=lambda: np.zeros(()))
    exposure: Array = field(default_factory=lambda: np.ones(()))
    blur: Array = field(default_factory=lambda: np.zeros(()))
    image_noise: Array = field(default_factory=lambda: np.array(2.0))
    occluder: Array = field(default_factory=lambda: np.zeros(5))
    object_mass: Array = field(default_factory=lambda: np.array(0.15))
    object_friction: Array = field(default_factory=lambda: np.array(0.9))
    marks: Array = field(default_factory=lambda: np.zeros((0, 3)))
    dock: Array = field(default_factory=lambda: np.zeros(3))
    slip: Array = field(default_factory=lambda: np.zeros(()))

    def __post_init__(self) -> None:
        self._check(_NAMES)

    def replace(self, **changes: ArrayLike) -> World:
        """The world with other values in some fields, of which only these are checked.

        Raises:
            ValueError: As at the making of a world.
        """
        if unknown := changes.keys() - _SHAPES.keys():
            raise _unknown(unknown)
        if not changes:
            return self
        there = object.__new__(World)
        vars(there).update(vars(self), **changes)
        there._check(tuple(changes))
        if there._lengths != self._lengths:
            there._check(_NAMES)
        return there

    @property
    def _lengths(self) -> tuple[int, int]:
        """How many motors and cameras there are."""
        return self.motor_sign.size, max((1, *self.camera_position.shape[:1]))

    def _check(self, names: tuple[str, ...]) -> None:
        """Turns these fields into read-only arrays of their shapes, and raises where one cannot be."""
        values = vars(self)
        for name in names:
            try:
                values[name] = np.array(values[name], np.float64)
            except (TypeError, ValueError, OverflowError):
                raise ValueError(f"World.{name} is {values[name]!r:.200}; it must be numbers") from None
        shapes = _shapes(*self._lengths)
        for name in names:
            if values[name].shape != shapes[name]:
                values[name] = _fitted(name, values[name], shapes[name])
            values[name] += 0.0  # no negative zero
            values[name].setflags(write=False)
        least, most = _bounds(names, tuple(values[name].shape for name in names))
        numbers = np.concatenate([values[name].ravel() for name in names])
        if not ((numbers >= least) & (numbers <= most)).all():
            self._refuse()
        if "motor_sign" in names and (np.abs(self.motor_sign) != 1).any():
            raise ValueError(f"World.motor_sign {_RANGES['motor_sign'].told}, found {self.motor_sign}")
        for name in ("latency", "texture"):
            if name in names and getattr(self, name) % 1:
                raise ValueError(f"World.{name} {_RANGES[name].told}, found {getattr(self, name)}")
        for name in ("camera_orientation", "light_direction"):
            if name in names:
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
        """Plain lists and floats under the names of the fields; `from_dict` gets them back exactly.

        Fields of a base are left out where there is none; some that came later, where they change nothing.
        """
        left_out = {name for name, usual in _CAME_LATER.items() if (getattr(self, name) == usual).all()}
        if not len(self.marks):
            left_out.update(_OF_A_BASE)
        return {name: getattr(self, name).tolist() for name in _NAMES if name not in left_out}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> World:
        """The world that `to_dict` wrote; fields that have a default may be missing.

        Raises:
            ValueError: It is no mapping; or a field is missing, unknown, or of the wrong shape.
        """
        if not isinstance(values, Mapping):
            raise ValueError(f"a World is {values!r:.200}; it must be a mapping, as `to_dict` gives it")
        needed = {each.name for each in fields(cls) if each.default_factory is MISSING}
        if missing := sorted(needed - values.keys()):
            raise ValueError(f"a World lacks {', '.join(missing)}")
        if unknown := values.keys() - _SHAPES.keys():
            raise _unknown(unknown)
        return cls(**values)

    @property
    def register_bound(self) -> float:
        """Registers are within +- this, and observation spaces within +-1 or more."""
        return max(1.0, float(1 / self.word_gain.min()))

    def check_fits(self, robot: Robot) -> None:
        """Raises where this is no world of that robot.

        Raises:
            ValueError: A field has another length; names what the robot has.
        """
        for name, what in _PARTS.items():
            found, expected = getattr(self, name).shape, getattr(robot, what)
            if found[0] != len(expected):
                must = (len(expected), *found[1:])
                raise ValueError(
                    f"World.{name} has shape {found}; it must be {must}: the robot's {what} are "
                    f"{', '.join(expected)}"
                )
        if robot.wheels and self.motor_coupling.any():
            found = self.motor_coupling.tolist()
            raise ValueError(f"World.motor_coupling is {found}; wheels are not coupled")
        if len(self.marks) != len(robot.marks):
            raise ValueError(
                f"World.marks has shape {self.marks.shape}; it must be {robot.marks.shape}: so many marks "
                "stand on the robot's front"
            )


_PARTS = {
    "camera_position": "cameras",
    "motor_sign": "motors",
    "joint_zeros": "joints",
    "link_lengths": "links",
}
"""Of which parts of the robot a field tells the number."""
_SHAPES: dict[str, tuple[int | str, ...]] = {
    "camera_position": ("c", 3),
    "camera_orientation": ("c", 4),
    "focal_length": ("c",),
    "principal_point": ("c", 2),
    "lens_k1": ("c",),
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
    "motor_coupling": ("m",),
    "lens_k2": ("c",),
    "pixel_aspect": ("c",),
    "light_direction": (3,),
    "light_strength": (),
    "light_ambient": (),
    "texture": (),
    "exposure": ("c",),
    "blur": ("c",),
    "image_noise": ("c",),
    "occluder": (5,),
    "object_mass": (),
    "object_friction": (),
    "marks": ("d", 3),
    "dock": (3,),
    "slip": (),
}
_OF_A_BASE = "marks", "dock", "slip"
_CAME_LATER = {"motor_coupling": 0.0, "lens_k2": 0.0, "pixel_aspect": 1.0}
"""Fields that stand in no dict where they have this value: worlds of before keep their dicts."""
_NAMES = tuple(_SHAPES)
_OF_ALL = (
    *("backlash", "repeatability", "register_noise", "register_step", "shortfall", "longest_motion"),
    *("word_gain", "dead_zone", "gear_ripple", "motor_coupling", "lens_k2", "pixel_aspect"),
    *("exposure", "blur", "image_noise"),
)
"""Fields of which one value may be given for all motors or cameras."""


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
    "motor_coupling": _Range(-MAX_COUPLING, MAX_COUPLING, f"must be within +-{MAX_COUPLING:g}"),
    "pixel_aspect": _POSITIVE,
    "light_strength": _NOT_NEGATIVE,
    "light_ambient": _NOT_NEGATIVE,
    "texture": _Range(0.0, MAX_TEXTURE, f"must be a whole number from 0 to {MAX_TEXTURE}"),
    "exposure": _POSITIVE,
    "blur": _NOT_NEGATIVE,
    "image_noise": _NOT_NEGATIVE,
    "occluder": _Range([*[-_LARGEST] * 3, 0.0, 0.0], _LARGEST, "has a negative radius or height"),
    "object_mass": _POSITIVE,
    "object_friction": _POSITIVE,
    "slip": _Range(0.0, MAX_SLIP, f"must be in [0, {MAX_SLIP:g}]"),
}


def _unknown(names: Iterable[object]) -> ValueError:
    found = ", ".join(sorted(map(str, names)))
    return ValueError(f"a World has no field {found}; it has {', '.join(_NAMES)}")


@lru_cache
def _shapes(motors: int, cameras: int) -> dict[str, tuple[int | str, ...]]:
    """Shapes of the fields with so many motors and cameras; letters stand for lengths that are free."""
    of: dict[int | str, int] = {"m": motors, "c": cameras}
    return {name: tuple(of.get(n, n) for n in shape) for name, shape in _SHAPES.items()}


@lru_cache
def _bounds(names: tuple[str, ...], shapes: tuple[tuple[int, ...], ...]) -> tuple[Array, Array]:
    """Least and largest values of all numbers of these fields, which have these shapes."""
    ends: tuple[list[Array], list[Array]] = [], []
    for name, shape in zip(names, shapes, strict=True):
        least, most, _ = _RANGES.get(name, _FINITE)
        for found, end in zip(ends, (least, most), strict=True):
            found.append(np.broadcast_to(np.asarray(end, float), shape).ravel())
    return np.concatenate(ends[0]), np.concatenate(ends[1])


def _fitted(name: str, array: Array, shape: tuple[int | str, ...]) -> Array:
    """A field in its shape, of which lengths may be free, or which one value for all may have.

    Raises:
        ValueError: It does not fit.
    """
    if name in _OF_ALL and array.shape == shape[1:]:
        filled = np.empty([int(n) for n in shape])
        filled[:] = array
        return filled
    fits = (free in ("k", "l", "d", length) for free, length in zip(shape, array.shape, strict=False))
    if array.ndim != len(shape) or not all(fits):
        written = str(shape).replace("'", "")
        raise ValueError(f"World.{name} has shape {array.shape}; it must be {written}")
    return array
