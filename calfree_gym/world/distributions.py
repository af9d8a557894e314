"""How worlds are drawn, and which world or distribution an environment was given."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.geometry import Array, looking_at, quaternion_about, quaternion_product
from calfree_gym.image import IMAGE_SIZE, PIXELS_PER_UNIT
from calfree_gym.robot.arms.arm import Arm, ArmChoice, robot_of
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Rig, Robot, kept_with_robot
from calfree_gym.streams import stream
from calfree_gym.world.docking import Draw, misaimed, on_wheels
from calfree_gym.world.value import MAX_TEXTURE, World

FOCAL_LENGTH = IMAGE_SIZE / 2 / np.tan(np.radians(40.0))
"""Nominal focal length in pixels: a field of view of 80 degrees."""
WILD_ELEVATION, WILD_STRENGTH, WILD_AMBIENT = (30, 80), (0.3, 0.8), (0.3, 0.6)
"""Of the lamp of wild worlds, the first in degrees. Choice: every place of a room with one lamp."""
SPAN_OF_A_HINGE = 2.0
"""What a slide's span is compared with (rad), where quantities of hinges are drawn in degrees."""
WORK_SPACE = 0.4
"""Half of how far the RV-M2's work space extends (m)."""
WILDER_DISTANCE, WILDER_SHARE, WILDER_AIM = (0.3, 5.0), (0.4, 1.25), 0.8
"""Of cameras of wilder worlds, for the RV-M2: their distance (m); how much of the image the work space fills
from there; and how far from its middle they look at most (m): two in five see enough of it. Choice."""
WILDER_OFFSET, WILDER_ASPECT, WILDER_BEND = 50.0, (0.8, 1.25), 0.08
"""Their principal point (px), their pixels, and by what share either number of the lens moves the border."""
RIPPLE_PERIOD, MOST_RIPPLE, MOST_COUPLING = (0.05, 0.5), 0.3, 0.3
"""Of the motors of wilder worlds: periods in registers, depths up to four times what was measured of hobby
servos, and couplings either way. Choice."""
ENCODER_STEP, DETENT = 360 / 4096, 360 / 29
"""Of a hobby servo's encoder and of its gears, in degrees: see docs/worlds.md."""


def nominal(robot: Robot | ArmChoice = MOVEMASTER) -> World:
    """The built robot, by default the RV-M2, perfectly calibrated, with image points of 0.5 px noise."""
    return _built(_robot(robot))


def _robot(robot: Robot | ArmChoice) -> Robot:
    return robot_of(robot) if isinstance(robot, str | Arm | Mapping) else robot


@kept_with_robot
def _built(robot: Robot) -> World:
    rig, motors, cameras = robot.rig, len(robot.motors), len(robot.cameras)
    return World(
        camera_position=rig.position,
        camera_orientation=np.stack([looking_at(p, rig.target) for p in rig.position]),
        focal_length=np.full(cameras, FOCAL_LENGTH),
        principal_point=np.zeros((cameras, 2)),
        lens_k1=np.zeros(cameras),
        link_lengths=robot.lengths,
        joint_zeros=np.zeros(len(robot.joints)),
        motor_sign=np.ones(motors),
        motor_gain=np.ones(motors),
        motor_curvature=np.zeros(motors),
        point_noise=np.array(0.5),
    )


def _nominal(draw: Draw, robot: Robot) -> World:
    return nominal(robot)


def _coarse(draw: Draw, robot: Robot) -> World:
    """The paper's coarsely calibrated robot: cameras up to 20 degrees off in any direction."""
    built = nominal(robot)
    return World(
        camera_position=built.camera_position,
        camera_orientation=misaimed(built.camera_orientation, draw("aim")),
        focal_length=built.focal_length * draw("focal_length").uniform(0.8, 1.2, len(robot.cameras)),
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
    cameras = [wild_camera(draw("cameras_" + name), i, robot.rig) for i, name in enumerate(robot.cameras)]
    principal = {"principal_point": nominal(robot).principal_point}
    return World(**_together(cameras), **principal, **_wild_arm(draw, robot))


def _together(cameras: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """The fields of all cameras, from those of each."""
    return {name: np.stack([each[name] for each in cameras]) for name in cameras[0]}


def _wild_arm(draw: Draw, robot: Robot) -> dict[str, Any]:
    """All of a wild world but the geometry of its cameras."""
    built, motors, sees = nominal(robot), len(robot.motors), len(robot.cameras)
    return {
        "link_lengths": built.link_lengths * draw("link_lengths").uniform(0.9, 1.1, len(robot.links)),
        "joint_zeros": _zeros(draw("joint_zeros"), 10.0, robot),
        "motor_sign": np.where(draw("motor_sign").integers(2, size=motors), 1.0, -1.0),
        "motor_gain": log_uniform(draw("motor_gain"), 0.5, 2.0, motors),
        "motor_curvature": draw("motor_curvature").uniform(-0.3, 0.4, motors),
        "point_noise": built.point_noise,
        **wild_light(draw("light")),
        "texture": np.array(draw("texture").integers(1, MAX_TEXTURE), float),
        "exposure": log_uniform(draw("exposure"), 0.7, 1.4, sees),
        "blur": draw("blur").uniform(0.0, 1.2, sees),
        "image_noise": draw("image_noise").uniform(1.0, 5.0, sees),
        "object_mass": log_uniform(draw("object_mass"), 0.05, 0.3),
        "object_friction": np.asarray(draw("object_friction").uniform(0.6, 1.2)),
    }


def _rough(draw: Draw, robot: Robot) -> World:
    """A wild arm with hobby servos; the numbers and their sources are in docs/worlds.md."""
    wild, motors = _wild(draw, robot), len(robot.motors)
    degree = np.radians(np.where(robot.slides, robot.span / SPAN_OF_A_HINGE, 1.0))
    registers = degree / (robot.span * wild.motor_gain)
    ripple = draw("gear_ripple")
    return replace(
        wild,
        register_noise=draw("register_noise").uniform(0.03, 0.06, motors) * registers,
        register_step=ENCODER_STEP * registers,
        shortfall=draw("shortfall").uniform(0.0, 0.02, motors),
        backlash=draw("backlash").uniform(0.5, 1.3, motors) * degree,
        repeatability=draw("repeatability").uniform(0.05, 0.15, motors) * degree,
        dead_zone=draw("dead_zone").uniform(1.0, 3.0, motors) * ENCODER_STEP * registers,
        gear_ripple=np.stack(
            [DETENT * registers, ripple.uniform(-np.pi, np.pi, motors), ripple.uniform(0, 0.07, motors)], -1
        ),
    )


def _wilder(draw: Draw, robot: Robot) -> World:
    """A wild arm whose motors are coupled and rippled, seen by any cameras from anywhere, with any noise."""
    if robot.wheels:
        raise ValueError("world 'wilder' is of arms: the cameras of a robot on wheels ride on it")
    motors, ripple = len(robot.motors), draw("gear_ripple")
    cameras = [wilder_camera(draw("cameras_" + name), robot.rig) for name in robot.cameras]
    period = log_uniform(ripple, *RIPPLE_PERIOD, motors)
    phase, depth = ripple.uniform(-np.pi, np.pi, motors), ripple.uniform(0, MOST_RIPPLE, motors)
    wilder = {
        "gear_ripple": np.stack([period, phase, depth], -1),
        "motor_coupling": draw("motor_coupling").uniform(-MOST_COUPLING, MOST_COUPLING, motors),
        "point_noise": draw("point_noise").uniform(0, 2),
    }
    return World(**_together(cameras), **{**_wild_arm(draw, robot), **wilder})


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


def wilder_camera(rng: np.random.Generator, rig: Rig) -> dict[str, Array]:
    """One camera's fields: 0.3 to 5 m from the work space's middle (RV-M2), no lower, on any side, any roll.

    Numbers of the lens are relative to the image's border: any focal length bends it alike.
    """
    far = log_uniform(rng, *WILDER_DISTANCE) * rig.scale
    side = random_direction(rng)
    position = rig.target + far * np.array([side[0], side[1], abs(side[2])])
    aim = rig.target + random_direction(rng) * (rig.scale * WILDER_AIM) * rng.uniform()
    roll = quaternion_about(np.array([0.0, 0.0, 1.0]), rng.uniform(-np.pi, np.pi))
    border = log_uniform(rng, *WILDER_SHARE) * far / (WORK_SPACE * rig.scale)
    by_square, by_fourth = rng.uniform(-WILDER_BEND, WILDER_BEND, 2)
    return {
        "camera_position": position,
        "camera_orientation": quaternion_product(looking_at(position, aim), roll),
        "focal_length": np.asarray(PIXELS_PER_UNIT * border),
        "principal_point": rng.uniform(-WILDER_OFFSET, WILDER_OFFSET, 2),
        "lens_k1": np.asarray(by_square * border**2),
        "lens_k2": np.asarray(by_fourth * border**4),
        "pixel_aspect": np.asarray(log_uniform(rng, *WILDER_ASPECT)),
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
    "rough": _rough,
    "wilder": _wilder,
}


@dataclass(frozen=True)
class WorldDistribution:
    """How to draw a world: "nominal", "coarse", "wild", "rough" or "wilder".

    Every group of fields has a random stream of its own, so that a new field changes no other draw.
    """

    name: str

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or self.name not in DISTRIBUTIONS:
            raise ValueError(
                f"unknown world {self.name!r}{near_misses(self.name, DISTRIBUTIONS)}; a world is a "
                f"calfree_gym.World or one of {', '.join(DISTRIBUTIONS)}"
            )

    @property
    def register_bound(self) -> float:
        """As `World.register_bound`, of all that it draws."""
        return 1.0

    def sample(
        self, seed: int, attempt: int = 0, trial: int = 0, robot: Robot | ArmChoice = MOVEMASTER
    ) -> World:
        """The world of `seed`.

        Args:
            seed: Non-negative.
            attempt: How many draws before it were out of view.
            trial: The trial, where each has a world of its own.
            robot: The arm, as `arm` of an environment.
        """
        robot = _robot(robot)

        def draw(group: str) -> np.random.Generator:
            return stream(seed, "world_" + group, trial, attempt)

        world = DISTRIBUTIONS[self.name](draw, robot)
        return on_wheels(self.name, world, draw, robot) if robot.wheels else world


WorldChoice = str | World | WorldDistribution | Mapping[str, Any]
"""A world, also as `World.to_dict` gives it, or a distribution of worlds or its name."""


def world_choices(world: Any, rows: int) -> list[World | WorldDistribution]:
    """One choice a row, from one for all of them or from a list.

    Raises:
        ValueError: The list has another length, or there is no such world.
    """
    if not isinstance(world, list | tuple):
        return [_choice(world)] * rows
    if len(world) != rows:
        raise ValueError(f"world is a list of {len(world)}; it must have {rows}, one an environment")
    return [_choice(each) for each in world]


def _choice(world: Any) -> World | WorldDistribution:
    if isinstance(world, World | WorldDistribution):
        return world
    return World.from_dict(world) if isinstance(world, Mapping) else WorldDistribution(world)
