"""What may differ between a robot and the robot as built: one vector of parameters, with names."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.observation import Array
from .robot_model import RobotModel
from .rotations import rotation


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
