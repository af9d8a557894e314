"""World: everything that the controller does not know, as one value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

import numpy as np

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
        motors = np.size(self.motor_sign)
        for entry in fields(self):
            given = getattr(self, entry.name)
            try:
                array = np.array(np.asarray(given, np.float64) + 0.0)  # no negative zero
            except (TypeError, ValueError):
                raise ValueError(f"World.{entry.name} is {given!r}; it must be numbers") from None
            shape = tuple(motors if size == "m" else size for size in _SHAPES[entry.name])
            if entry.name in _OF_ALL_MOTORS and array.shape == shape[1:]:
                array = np.tile(array, (motors,) + (1,) * array.ndim)
            if array.ndim != len(shape) or any(
                size not in ("k", "l", found) for size, found in zip(shape, array.shape, strict=True)
            ):
                raise ValueError(f"World.{entry.name} has shape {array.shape}; it must be {_written(shape)}")
            if not np.isfinite(array).all():
                raise ValueError(f"World.{entry.name} must be finite, found {array.tolist()}")
            array.flags.writeable = False
            object.__setattr__(self, entry.name, array)
        self._check_ranges()

    def _check_ranges(self) -> None:
        for name in _POSITIVE:
            if (getattr(self, name) <= 0).any():
                raise ValueError(f"World.{name} must be positive, found {getattr(self, name)}")
        if (np.abs(self.motor_sign) != 1).any():
            raise ValueError(f"World.motor_sign must be +1 or -1, found {self.motor_sign}")
        if (np.abs(self.motor_curvature) > 0.45).any():
            raise ValueError(f"World.motor_curvature must be within +-0.45, found {self.motor_curvature}")
        for name in _NOT_NEGATIVE:
            if (getattr(self, name) < 0).any():
                raise ValueError(f"World.{name} must not be negative, found {getattr(self, name)}")
        for name, (least, most) in _WITHIN.items():
            if ((getattr(self, name) < least) | (getattr(self, name) > most)).any():
                raise ValueError(
                    f"World.{name} must be in [{least:g}, {most:g}], found {getattr(self, name)}"
                )
        if (self.longest_motion > 1).any():
            raise ValueError(f"World.longest_motion must be in (0, 1], found {self.longest_motion}")
        period, _, depth = self.gear_ripple.T
        if not ((period >= 1e-3) & (period <= 1e3) & (depth >= 0) & (depth < 1)).all():
            raise ValueError(
                "World.gear_ripple must have periods (first) in [0.001, 1000] and depths (third) in [0, 1), "
                f"found {self.gear_ripple.tolist()}"
            )
        if (self.occluder[3:] < 0).any():
            raise ValueError(f"World.occluder has a negative radius or height: {self.occluder}")
        if self.latency not in range(MAX_LATENCY + 1):
            raise ValueError(
                f"World.latency must be a whole number from 0 to {MAX_LATENCY}, found {self.latency}"
            )
        if self.texture % 1 or not 0 <= self.texture <= MAX_TEXTURE:
            raise ValueError(
                f"World.texture must be a whole number from 0 to {MAX_TEXTURE}, found {self.texture}"
            )
        for name in ("camera_orientation", "light_direction"):
            norms = np.linalg.norm(getattr(self, name), axis=-1)
            if (np.abs(norms - 1) > 1e-6).any():
                raise ValueError(f"World.{name} must have unit length, found {norms}")

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


def _written(shape: tuple[int | str, ...]) -> str:
    """A shape as Python writes it, with letters for lengths that are free."""
    return str(shape).replace("'", "")


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
_POSITIVE = (
    *("focal_length", "link_lengths", "motor_gain", "longest_motion", "exposure"),
    *("object_mass", "object_friction"),
)
_NOT_NEGATIVE = (
    "point_noise",
    "backlash",
    "repeatability",
    "register_noise",
    "register_step",
    "light_strength",
    "light_ambient",
    "blur",
    "image_noise",
)
_WITHIN = {
    **{"point_outliers": (0.0, 1.0), "point_dropout": (0.0, 1.0)},
    **{"shortfall": (0.0, MAX_SHORTFALL), "word_gain": (1e-3, 1e3), "dead_zone": (0.0, 1.0)},
}
