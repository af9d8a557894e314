"""Image points that a robot is to measure, and their derivatives by all that may differ in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS
from calfree_gym.vision.cameras import image_points, pinhole

from ..base.checks import checked_array
from ..base.observation import POINTS, Array, Flags, Observation
from .robot_model import RobotModel, rotation, rotation_axes

MOTORS = 3


@dataclass(frozen=True)
class Measurements:
    """Image points measured at known registers, in several trials.

    Attributes:
        registers: (n, 3).
        points: Image points (n, 4, 2) in image units: gripper left, right, object left, right.
        seen: Which of them were seen (n, 4).
        trial: In which trial (n,), counted from 0 and rising: each has an object of its own.
    """

    registers: Array
    points: Array
    seen: Flags
    trial: NDArray[np.int_]

    @classmethod
    def none(cls) -> Measurements:
        """Nothing measured yet."""
        points = np.zeros((0, POINTS, 2))
        return cls(np.zeros((0, MOTORS)), points, np.zeros((0, POINTS), bool), np.zeros(0, int))

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Measurements:
        """What was saved under the names of the attributes.

        Raises:
            ValueError: An array is missing or of a wrong shape, or trials are not counted from 0.
        """
        points = checked_array(arrays, "points", (None, POINTS, 2))
        count = len(points)
        registers = checked_array(arrays, "registers", (count, MOTORS))
        seen = checked_array(arrays, "seen", (count, POINTS)) > 0
        trial = checked_array(arrays, "trial", (count,)).astype(int)
        if count and not (trial[0] == 0 and np.isin(np.diff(trial), (0, 1)).all()):
            raise ValueError(f"the saved trial must count from 0 in steps of 1, found {trial.tolist()}")
        return cls(registers, points, seen, trial)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.trial.max(initial=-1)) + 1

    def with_trial(self, observations: Sequence[Observation]) -> Measurements:
        """These, and those of one more trial."""
        return Measurements(
            np.concatenate([self.registers, [each.registers for each in observations]]),
            np.concatenate([self.points, [each.points for each in observations]]),
            np.concatenate([self.seen, [each.visible for each in observations]]),
            np.concatenate([self.trial, np.full(len(observations), self.trials)]),
        )

    def latest(self, count: int) -> Measurements:
        """The last `count` of them, their trials counted from 0 again."""
        trial = self.trial[-count:]
        trial = trial - trial.min(initial=self.trials)
        return Measurements(self.registers[-count:], self.points[-count:], self.seen[-count:], trial)


@dataclass(frozen=True)
class Parameter:
    """One quantity in which the robot may differ from the robot as built.

    Attributes:
        name: Of the quantity.
        shape: Of its array; of cameras, the first axis is left, right.
        prior_std: Standard deviation before anything is measured; the prior mean is 0.
        bound: It differs by no more than this.
        unit: Of both.
    """

    name: str
    shape: tuple[int, ...]
    prior_std: float | tuple[float, ...]
    bound: float | tuple[float, ...]
    unit: str

    @property
    def size(self) -> int:
        """How many numbers it is."""
        return int(np.prod(self.shape))

    def filled(self, values: float | tuple[float, ...]) -> Array:
        """`values`, one for all or one for each entry of the last axis, for each number (size,)."""
        return np.broadcast_to(values, self.shape).ravel()


CAMERA_PARAMETERS = (
    Parameter("camera_position", (2, 3), 0.05, 0.15, "m"),
    Parameter("camera_turn", (2, 3), (0.15, 0.15, 10.0), (0.6, 0.6, 20.0), "rad about x, y, z"),
    Parameter("focal_length", (2, 1), 0.25, 0.8, "logarithm of a factor"),
    Parameter("lens_k1", (2, 1), 0.05, 0.15, "per squared focal length"),
)
ARM_PARAMETERS = (
    Parameter("link_lengths", (5,), 0.06, 0.2, "share of the length as built"),
    Parameter("joint_zeros", (4,), 0.10, 0.3, "rad"),
    Parameter("motor_gain", (3,), 0.4, 0.9, "logarithm of a factor"),
    Parameter("motor_curvature", (3,), 0.2, 0.43, "1"),
)
PARAMETERS = CAMERA_PARAMETERS + ARM_PARAMETERS
"""In the order of the vector, which is also that of saved files.

The standard deviations are those with which the simulator draws its wild worlds, rounded: a robot that starts
from them knows how wrong robots are there. Only tilts (about x and y; 0.08 in wild worlds) have twice the
room, and rolls (about z) are left open. Bounds are 1.1 to 3 times the largest differences of wild worlds
(guards), and beyond a curvature of 0.45 a world would be refused."""
COUNT = sum(each.size for each in PARAMETERS)
ARM = slice(sum(each.size for each in CAMERA_PARAMETERS), COUNT)
"""Where in the vector the arm's parameters are; those before are the cameras'."""
PRIOR_STD = np.concatenate([each.filled(each.prior_std) for each in PARAMETERS])
_NEGLIGIBLE = 1e-6
"""Share of its standard deviation that a quantity keeps which a model lacks (a guard: it is divided by)."""
BOUND = np.concatenate([each.filled(each.bound) for each in PARAMETERS])
_ENDS = np.cumsum([each.size for each in PARAMETERS])
_PLACES = {
    each.name: slice(int(end) - each.size, int(end)) for each, end in zip(PARAMETERS, _ENDS, strict=True)
}


def prior_std(lacking: Collection[str] = ()) -> Array:
    """Prior standard deviations (COUNT,) for a model that lacks some quantities: these stay as built."""
    std = PRIOR_STD.copy()
    for name, values in named(std).items():
        values *= _NEGLIGIBLE if name in lacking else 1.0
    return std


def named(parameters: Array) -> dict[str, Array]:
    """The parameters (..., COUNT) by name, as views of their shapes (..., *shape): write to them at will."""
    leading = parameters.shape[:-1]
    return {
        each.name: parameters[..., _PLACES[each.name]].reshape(leading + each.shape) for each in PARAMETERS
    }


def model_of(built: RobotModel, signs: Array, parameters: Array) -> RobotModel:
    """The robot that differs from the robot as built by `parameters`.

    Args:
        built: The robot as built.
        signs: Of the motors (..., 3).
        parameters: (..., COUNT); with leading axes, several robots.
    """
    off = named(parameters)
    return replace(
        built,
        camera_position=built.camera_position + off["camera_position"],
        camera_axes=built.camera_axes @ rotation(off["camera_turn"]),
        focal_length=built.focal_length * np.exp(off["focal_length"][..., 0]),
        lens_k1=built.lens_k1 + off["lens_k1"][..., 0],
        **_arm(built, signs, off),
    )


def arm_of(built: RobotModel, signs: Array, parameters: Array) -> RobotModel:
    """As `model_of`, with the cameras as built."""
    return replace(built, **_arm(built, signs, named(parameters)))


def _arm(built: RobotModel, signs: Array, off: dict[str, Array]) -> dict[str, Any]:
    return {
        "link_lengths": built.link_lengths * (1 + off["link_lengths"]),
        "joint_zeros": built.joint_zeros + off["joint_zeros"],
        "motor_gain": built.motor_gain * signs * np.exp(off["motor_gain"]),
        "motor_curvature": built.motor_curvature + off["motor_curvature"],
    }


_STEP = 1e-6
"""Of forward differences, in rad or shares: their error is then below 1e-6 (derived: half of it, by second
derivatives of about 1 m) and that of rounding negligible (2e-16 / 1e-6)."""


class Prediction:
    """Image points that robots are to measure where measurements were made.

    Several robots at once, s of them, each with its own parameters and its own places of the objects.

    Attributes:
        points: Image points (s, n, 4, 2).

    Args:
        measurements: Where, n of them.
        built: The robot as built.
        signs: Of each robot's motors (s, 3).
        x: Each robot's parameters, then each trial's object in m: (s, COUNT + 3 trials).
    """

    def __init__(self, measurements: Measurements, built: RobotModel, signs: Array, x: Array) -> None:
        self._registers, self._trial = measurements.registers, measurements.trial
        self._built, self._signs = built, signs
        self._parameters = x[:, :COUNT]
        self._objects = x[:, COUNT:].reshape(len(x), -1, 3)
        self._model = model_of(built, signs, self._parameters)
        self._joints = self._model.joints(self._registers)
        self._places = self._in_mount_frame(self._model, self._joints, self._objects)
        self._cameras = StereoPair(self._model, self._places.reshape(len(x), -1, 3))
        self.points = self._by_point(self._cameras.points).reshape(len(x), -1, POINTS, 2)

    def derivatives(self) -> Array:
        """Derivatives (s, n, 4, 2, COUNT + 3 trials) of the image points by x."""
        starts, count, trials = len(self._objects), len(self._trial), self._objects.shape[1]
        by_x = np.zeros((starts, count, 2, len(CAMERAS), 2, COUNT + 3 * trials))
        by_name = named(by_x[..., :COUNT])
        for name, by_camera in self._by_cameras().items():
            by_point = self._by_point(by_camera)
            for camera in range(len(CAMERAS)):
                by_name[name][..., camera, :, camera, :] = by_point[..., camera, :, :]
        by_place = self._by_point(self._cameras.by_place).reshape(starts, count, 2, 4, 3)
        by_arm = by_place @ self._places_by_arm()
        by_x[..., ARM] = by_arm.reshape(*by_x.shape[:-1], -1)
        by_object = by_place[:, :, 1] @ self._place_by_object()
        by_objects = by_x[..., COUNT:].reshape(*by_x.shape[:-1], trials, 3)
        own = by_object.reshape(starts, count, len(CAMERAS), 2, 3).swapaxes(0, 1)
        by_objects[:, np.arange(count), 1, :, :, self._trial] = own
        return by_x.reshape(starts, count, POINTS, 2, -1)

    def _by_point(self, values: Array) -> Array:
        """(s, cameras, 2 n, 2, ...) as (s, n, gripper and object, cameras, 2, ...)."""
        starts, cameras, _, *shape = values.shape
        return values.reshape(starts, cameras, -1, 2, *shape).swapaxes(1, 2).swapaxes(2, 3)

    def _by_cameras(self) -> dict[str, Array]:
        """Derivatives (s, cameras, 2 n, 2, ...) by the parameters of the points' camera, by name."""
        axes = rotation_axes(named(self._parameters)["camera_turn"])
        by_turn = self._cameras.by_turn
        return {
            "camera_position": -self._cameras.by_place,
            "camera_turn": (by_turn.reshape(*axes.shape[:2], -1, 3) @ axes).reshape(by_turn.shape),
            "focal_length": self._cameras.points[..., None],
            "lens_k1": self._cameras.by_k1[..., None],
        }

    def _places_by_arm(self) -> Array:
        """Derivatives (s, n, 2, 3, arm parameters) of the places of gripper and object, by differences."""
        further = self._parameters[:, None] + _STEP * np.eye(COUNT)[ARM]
        model = arm_of(self._built, self._signs[:, None], further)
        moved = self._in_mount_frame(model, model.joints(self._registers), self._objects[:, None])
        return np.moveaxis(moved - self._places[:, None], 1, -1) / _STEP

    def _place_by_object(self) -> Array:
        """Derivatives (s, n, 3, 3) of the objects' places in the mount's frame by those in the room."""
        units = np.broadcast_to(np.eye(3), (*self._joints.shape[:-1], 3, 3))
        return self._model.in_mount_frame(units, self._joints[..., None, :]).swapaxes(-1, -2)

    def _in_mount_frame(self, model: RobotModel, joints: Array, objects: Array) -> Array:
        """Places (..., n, 2, 3) of gripper and object in the frame of the cameras' mount."""
        both = np.empty((*joints.shape[:-1], 2, 3))
        both[..., 0, :], both[..., 1, :] = model.gripper(joints), objects[..., self._trial, :]
        return model.in_mount_frame(both, joints[..., None, :])


class StereoPair:
    """Image points in both cameras, and what they do when points or cameras move a little.

    The derivatives are the interaction matrices of visual servoing (Hutchinson, Hager & Corke 1996).

    Attributes:
        points: Image points (..., cameras, n, 2).

    Args:
        model: One model, or several along leading axes (...).
        places: Points in m, in the frame of the cameras' mount (..., n, 3).
    """

    def __init__(self, model: RobotModel, places: Array) -> None:
        self._axes = model.camera_axes
        self._focal = model.focal_length[..., None, None]
        self._k1 = model.lens_k1[..., None]
        position, axes = model.camera_position[..., None, :], model.camera_axes[..., None, :, :]
        self._flat, self._depth = pinhole(places[..., None, :, :], position, axes)
        self.points, _ = image_points(self._flat, self._focal, np.zeros(2), self._k1, 0.0, np.inf)

    @cached_property
    def by_place(self) -> Array:
        """Derivatives (..., cameras, n, 2, 3) by the place of the point, in m."""
        in_camera = self._by_direction / self._depth[..., None, None]
        rows = in_camera.reshape(*self._axes.shape[:-2], -1, 3)
        return (rows @ self._axes.swapaxes(-1, -2)).reshape(in_camera.shape)

    @property
    def by_turn(self) -> Array:
        """Derivatives (..., cameras, n, 2, 3) by small turns of the camera about its own axes, in rad."""
        x, y = self._flat[..., None, 0], self._flat[..., None, 1]
        by = self._by_direction
        by_x, by_y, by_depth = by[..., 0], by[..., 1], by[..., 2]
        by_turn = np.empty_like(by)  # by × (x, -y, -1), for which np.cross takes twice the time
        by_turn[..., 0] = by_depth * y - by_y
        by_turn[..., 1] = by_depth * x + by_x
        by_turn[..., 2] = -by_x * y - by_y * x
        return by_turn

    @property
    def by_k1(self) -> Array:
        """Derivatives (..., cameras, n, 2) by the lens's radial distortion."""
        return self._focal * self._flat * self._squared_radius[..., None]

    @cached_property
    def _by_direction(self) -> Array:
        """Derivatives (..., cameras, n, 2, 3) by points at depth 1 in camera axes (x right, y up)."""
        flat, k1 = self._flat, self._k1
        straight = self._focal[..., None] * (1 + k1 * self._squared_radius)[..., None, None] * np.eye(2)
        radial = self._focal[..., None] * 2 * k1[..., None, None] * flat[..., :, None] * flat[..., None, :]
        by_flat = straight + radial
        outwards = self._focal * (1 + 3 * k1 * self._squared_radius)[..., None] * flat
        by_direction = np.empty((*outwards.shape, 3))
        by_direction[..., 0], by_direction[..., 1] = by_flat[..., 0], -by_flat[..., 1]
        by_direction[..., 2] = outwards
        return by_direction

    @cached_property
    def _squared_radius(self) -> Array:
        return self._flat[..., 0] * self._flat[..., 0] + self._flat[..., 1] * self._flat[..., 1]
