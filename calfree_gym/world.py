"""World: everything that the controller does not know, as one value; and how to draw one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.geometry import Array, looking_at, quaternion_about, quaternion_product
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Rig, Robot
from calfree_gym.streams import stream
from calfree_gym.vision.latency import MAX_LATENCY

FOCAL_LENGTH = IMAGE_SIZE / 2 / np.tan(np.radians(40.0))
"""Nominal focal length in pixels: a field of view of 80 degrees."""
BUILT_LIGHT = np.array([-0.2, 0.45, -1.0]) / np.linalg.norm([-0.2, 0.45, -1.0])
"""Where the built robot's lamp shines."""
WILD_ELEVATION, WILD_STRENGTH, WILD_AMBIENT = (30, 80), (0.3, 0.8), (0.3, 0.6)
"""Of the lamp of wild worlds, the first in degrees. Choice: every place of a room with one lamp."""
SPAN_OF_A_HINGE = 2.0
"""What a slide's span is compared with (rad), where quantities of hinges are drawn in degrees."""


@dataclass(frozen=True, eq=False)
class World:
    """Cameras, arm, motors, measurement and light of one robot. Compares by value; arrays are read-only.

    The fields from `light_direction` on matter to rendered images alone, and `occluder` where points can be
    hidden.

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
        motor_curvature: Of the map from register to position (m,), see `motors`.
        point_noise: Standard deviation of an image coordinate in pixels ().
        point_outliers: Share of the points of an observation that stand anywhere in the image instead ().
        point_dropout: Share of the points of an observation that are not seen ().
        latency: Delay of image points and flags in motions (), a whole number.
        backlash: By how much a joint's position differs between both directions of motion, in rad or m (m,).
        repeatability: Standard deviation of a joint's position after a motion, in rad or m (m,).
        light_direction: Where the lamp shines (3,), of unit length, in the room.
        light_strength: How brightly it lights what faces it (), relative to white.
        light_ambient: How brightly all is lit from everywhere (), likewise.
        texture: Number of the pictures that cover table and room (), a whole number; 0: as built.
        exposure: Factor of each image's brightness (2,).
        blur: Standard deviation of each image's blur (2,), in pixels of 512.
        image_noise: Standard deviation of each image's noise (2,), in grey levels of 255.
        occluder: An upright cylinder that stands in the way (5,): its middle, its radius and half its height,
            in m, in the room; radius 0: none.
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
    backlash: Array = field(default_factory=lambda: np.zeros(0))
    repeatability: Array = field(default_factory=lambda: np.zeros(0))
    light_direction: Array = field(default_factory=BUILT_LIGHT.copy)
    light_strength: Array = field(default_factory=lambda: np.array(0.6))
    light_ambient: Array = field(default_factory=lambda: np.array(0.5))
    texture: Array = field(default_factory=lambda: np.zeros(()))
    exposure: Array = field(default_factory=lambda: np.ones(2))
    blur: Array = field(default_factory=lambda: np.zeros(2))
    image_noise: Array = field(default_factory=lambda: np.full(2, 2.0))
    occluder: Array = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        motors = np.size(self.motor_sign)
        for name in ("backlash", "repeatability"):
            if np.shape(getattr(self, name)) == (0,):  # not given: none
                object.__setattr__(self, name, np.zeros(motors))
        for entry in fields(self):
            array = np.array(np.asarray(getattr(self, entry.name), np.float64) + 0.0)  # no negative zero
            shape = tuple(motors if size == "m" else size for size in _SHAPES[entry.name])
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
        for name in ("focal_length", "link_lengths", "motor_gain", "exposure"):
            if (getattr(self, name) <= 0).any():
                raise ValueError(f"World.{name} must be positive, found {getattr(self, name)}")
        if (np.abs(self.motor_sign) != 1).any():
            raise ValueError(f"World.motor_sign must be +1 or -1, found {self.motor_sign}")
        if (np.abs(self.motor_curvature) > 0.45).any():
            raise ValueError(f"World.motor_curvature must be within +-0.45, found {self.motor_curvature}")
        for name in _NOT_NEGATIVE:
            if (getattr(self, name) < 0).any():
                raise ValueError(f"World.{name} must not be negative, found {getattr(self, name)}")
        if (self.occluder[3:] < 0).any():
            raise ValueError(f"World.occluder has a negative radius or height: {self.occluder}")
        for name in ("point_outliers", "point_dropout"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"World.{name} must be in [0, 1], found {getattr(self, name)}")
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
    "light_direction": (3,),
    "light_strength": (),
    "light_ambient": (),
    "texture": (),
    "exposure": (2,),
    "blur": (2,),
    "image_noise": (2,),
    "occluder": (5,),
}
_NOT_NEGATIVE = (
    "point_noise",
    "backlash",
    "repeatability",
    "light_strength",
    "light_ambient",
    "blur",
    "image_noise",
)
MAX_TEXTURE = 2**31 - 1


def nominal(robot: Robot = MOVEMASTER) -> World:
    """The built robot, perfectly calibrated, with image points of 0.5 px noise."""
    rig, motors = robot.rig, len(robot.motors)
    return World(
        camera_position=rig.position,
        camera_orientation=np.stack([looking_at(p, rig.target) for p in rig.position]),
        focal_length=np.full(2, FOCAL_LENGTH),
        principal_point=np.zeros((2, 2)),
        lens_k1=np.zeros(2),
        link_lengths=robot.lengths,
        joint_zeros=np.zeros(len(robot.joints)),
        motor_sign=np.ones(motors),
        motor_gain=np.ones(motors),
        motor_curvature=np.zeros(motors),
        point_noise=np.array(0.5),
    )


Draw = Callable[[str], np.random.Generator]
"""Gives the random stream of one group of world fields."""


def _nominal(draw: Draw, robot: Robot) -> World:
    return nominal(robot)


def _coarse(draw: Draw, robot: Robot) -> World:
    """The paper's coarsely calibrated robot: cameras up to 20 degrees off in any direction."""
    built = nominal(robot)
    orientation = np.stack(
        [
            quaternion_product(q, quaternion_about(rng.standard_normal(3), np.radians(rng.uniform(0, 20))))
            for q, rng in zip(built.camera_orientation, [draw("aim")] * 2, strict=True)
        ]
    )
    return World(
        camera_position=built.camera_position,
        camera_orientation=orientation,
        focal_length=built.focal_length * draw("focal_length").uniform(0.8, 1.2, 2),
        principal_point=built.principal_point,
        lens_k1=built.lens_k1,
        link_lengths=built.link_lengths * draw("link_lengths").uniform(0.98, 1.02, len(robot.links)),
        joint_zeros=_zeros(draw("joint_zeros"), 2.0, robot),
        motor_sign=built.motor_sign,
        motor_gain=draw("motor_gain").uniform(0.98, 1.02, len(robot.motors)),
        motor_curvature=built.motor_curvature,
        point_noise=built.point_noise,
    )


def _wild(draw: Draw, robot: Robot) -> World:
    """Cameras mounted roughly, on an arm that was never measured."""
    built, motors = nominal(robot), len(robot.motors)
    cameras = [wild_camera(draw("cameras_" + side), i, robot.rig) for i, side in enumerate(CAMERAS)]
    return World(
        camera_position=np.stack([c["camera_position"] for c in cameras]),
        camera_orientation=np.stack([c["camera_orientation"] for c in cameras]),
        focal_length=np.array([c["focal_length"] for c in cameras]),
        principal_point=built.principal_point,
        lens_k1=np.array([c["lens_k1"] for c in cameras]),
        link_lengths=built.link_lengths * draw("link_lengths").uniform(0.9, 1.1, len(robot.links)),
        joint_zeros=_zeros(draw("joint_zeros"), 10.0, robot),
        motor_sign=draw("motor_sign").choice([-1.0, 1.0], motors),
        motor_gain=log_uniform(draw("motor_gain"), 0.5, 2.0, motors),
        motor_curvature=draw("motor_curvature").uniform(-0.3, 0.4, motors),
        point_noise=built.point_noise,
        **wild_light(draw("light")),
        texture=np.array(draw("texture").integers(1, MAX_TEXTURE), float),
        exposure=log_uniform(draw("exposure"), 0.7, 1.4, 2),
        blur=draw("blur").uniform(0.0, 1.2, 2),
        image_noise=draw("image_noise").uniform(1.0, 5.0, 2),
    )


def wild_light(rng: np.random.Generator) -> dict[str, Any]:
    """The lamp's fields: 30 to 80 degrees above the table, anywhere around it."""
    around, above = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(*WILD_ELEVATION))
    return lamp(around, above, rng.uniform(*WILD_STRENGTH), rng.uniform(*WILD_AMBIENT))


def lamp(azimuth: float, elevation: float, strength: float, ambient: float) -> dict[str, Any]:
    """The fields of a lamp that stands at this azimuth and elevation, in rad."""
    level = np.cos(elevation)
    return {
        "light_direction": -np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]),
        "light_strength": strength,
        "light_ambient": ambient,
    }


def _zeros(rng: np.random.Generator, degrees: float, robot: Robot) -> Array:
    """Zero errors (k,) within these degrees; a slide's span counts as 2 rad."""
    zeros = np.radians(rng.uniform(-degrees, degrees, len(robot.joints)))
    slides = np.flatnonzero(robot.slides)
    zeros[slides] *= robot.span[slides] / SPAN_OF_A_HINGE
    return np.asarray(zeros)


def wild_camera(rng: np.random.Generator, camera: int, rig: Rig) -> dict[str, Array]:
    """One camera's fields: displaced by up to 10 cm (RV-M2), re-aimed, any roll, focal length x0.67-1.5."""
    position = rig.position[camera] + random_direction(rng) * (rig.scale * 0.10) * rng.uniform() ** (1 / 3)
    aimed = looking_at(position, rig.target + rng.uniform(-0.05, 0.05, 3) * rig.scale)
    roll = quaternion_about(np.array([0.0, 0.0, 1.0]), rng.uniform(-np.pi, np.pi))
    return {
        "camera_position": position,
        "camera_orientation": quaternion_product(aimed, roll),
        "focal_length": FOCAL_LENGTH * log_uniform(rng, 0.67, 1.5),
        "lens_k1": np.asarray(rng.uniform(-0.08, 0.08)),
    }


def random_direction(rng: np.random.Generator) -> Array:
    """A unit vector (3,), uniform on the sphere."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


def log_uniform(rng: np.random.Generator, low: float, high: float, size: int | None = None) -> Any:
    """Numbers whose logarithms are uniform between those of `low` and `high`."""
    return np.exp(rng.uniform(np.log(low), np.log(high), size))


DISTRIBUTIONS: dict[str, Callable[[Draw, Robot], World]] = {
    "nominal": _nominal,
    "coarse": _coarse,
    "wild": _wild,
}


@dataclass(frozen=True)
class WorldDistribution:
    """How to draw a world: "nominal", "coarse" or "wild".

    Every group of fields has a random stream of its own, so that a new field changes no other draw.
    """

    name: str

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or self.name not in DISTRIBUTIONS:
            raise ValueError(
                f"unknown world {self.name!r}{near_misses(self.name, DISTRIBUTIONS)}; a world is a "
                f"calfree_gym.World or one of {', '.join(DISTRIBUTIONS)}"
            )

    def sample(self, seed: int, attempt: int = 0, trial: int = 0, robot: Robot = MOVEMASTER) -> World:
        """The world of `seed`.

        Args:
            seed: Non-negative.
            attempt: How many draws before it were out of view.
            trial: The trial, where each has a world of its own.
            robot: The arm.
        """
        return DISTRIBUTIONS[self.name](lambda group: stream(seed, "world_" + group, trial, attempt), robot)
