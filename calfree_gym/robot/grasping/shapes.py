"""The things to be grasped: their shapes, as drawn or as given, and their main axes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from calfree_gym.errors import check_choice
from calfree_gym.geometry import Array
from calfree_gym.robot.grasping.gripping_arm import OPENING

LARGEST = 0.9
"""The jaws close on no side that is longer than this share of their opening. Choice: room to miss by."""
SMALLEST = 0.008
"""No half of a side is shorter than this (m): marks would not fit on it. Choice."""
LONGEST = 0.10
"""Nor longer than this (m)."""
CYLINDER, SPHERE, BOX = (
    mujoco.mjtGeom.mjGEOM_CYLINDER,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_BOX,
)


class Part(NamedTuple):
    """One primitive of a thing: its kind, its size (3,) as MuJoCo has it, and where it is (3,)."""

    kind: Any
    size: Array
    place: Array


class Thing(NamedTuple):
    """A thing to be grasped.

    Attributes:
        shape: Its shape's name.
        parts: What it is made of, in its own frame, whose origin is where jaws should close.
        axis: One end of its main axis (3,), as far from the origin as the other.
        height: Of the origin above the table (m).
        width: What must fit between the jaws (m).
    """

    shape: str
    parts: tuple[Part, ...]
    axis: Array
    height: float
    width: float


def _cylinder(radius: float, half_height: float) -> Thing:
    parts = (Part(CYLINDER, np.array([radius, half_height, 0.0]), np.zeros(3)),)
    return Thing("cylinder", parts, np.array([0.0, 0.0, half_height]), half_height, 2 * radius)


def _sphere(radius: float) -> Thing:
    parts = (Part(SPHERE, np.array([radius, 0.0, 0.0]), np.zeros(3)),)
    return Thing("sphere", parts, np.array([0.0, 0.0, radius]), radius, 2 * radius)


def _box(half_length: float, half_width: float, half_height: float, shape: str = "box") -> Thing:
    size = np.array([half_length, half_width, half_height])
    parts = (Part(BOX, size, np.zeros(3)),)
    return Thing(shape, parts, np.array([half_length, 0.0, 0.0]), half_height, 2 * half_width)


def _bar(half_length: float, half_width: float, half_height: float) -> Thing:
    return _box(half_length, half_width, half_height, "bar")


def _l_shape(half_length: float, half_width: float, half_height: float, half_foot: float) -> Thing:
    """A bar, and at its end a foot to one side, as wide and as high as the bar."""
    bar = _bar(half_length, half_width, half_height)
    foot = Part(
        BOX,
        np.array([half_width, half_foot, half_height]),
        np.array([half_length - half_width, half_width + half_foot, 0.0]),
    )
    return bar._replace(shape="l_shape", parts=(*bar.parts, foot))


class Shape(NamedTuple):
    """How things of a shape are made, and between which sizes (m) they are drawn."""

    make: Callable[..., Thing]
    sizes: dict[str, tuple[float, float]]


SHAPES = {
    "cylinder": Shape(_cylinder, {"radius": (0.014, 0.025), "half_height": (0.022, 0.040)}),
    "sphere": Shape(_sphere, {"radius": (0.018, 0.028)}),
    "box": Shape(
        _box, {"half_length": (0.022, 0.032), "half_width": (0.013, 0.020), "half_height": (0.018, 0.035)}
    ),
    "bar": Shape(
        _bar, {"half_length": (0.045, 0.070), "half_width": (0.010, 0.016), "half_height": (0.012, 0.018)}
    ),
    "l_shape": Shape(
        _l_shape,
        {
            "half_length": (0.055, 0.070),
            "half_width": (0.010, 0.013),
            "half_height": (0.012, 0.018),
            "half_foot": (0.015, 0.025),
        },
    ),
}
"""Upright cylinder, sphere, box, bar and L, lying at any angle. Sizes: what this hand grasps."""
SHAPE_NAMES = tuple(SHAPES)
ShapeChoice = str | Mapping[str, Any] | None
"""A shape's name, a mapping of `shape` and all of its sizes in m, or None: any."""


def check_shape(choice: ShapeChoice) -> None:
    """Raises where there are no such things, or the jaws cannot hold them.

    Raises:
        ValueError: Names what was found, and what is allowed.
    """
    if choice is None:
        return
    if not isinstance(choice, Mapping):
        check_choice("shape", choice, SHAPE_NAMES)
        return
    if "shape" not in choice:
        raise ValueError(f"shape is {dict(choice)!r}; a mapping has `shape`, and its sizes in m")
    check_choice("shape", choice["shape"], SHAPE_NAMES)
    needed = SHAPES[choice["shape"]].sizes
    if (found := choice.keys() - {"shape"}) != needed.keys():
        raise ValueError(f"a {choice['shape']} has {sorted(found)}; it must have {', '.join(needed)}, in m")
    for name in needed:
        value = choice[name]
        if isinstance(value, bool) or not isinstance(value, int | float) or not SMALLEST <= value <= LONGEST:
            raise ValueError(f"{name} is {value!r}; it must be a number from {SMALLEST} to {LONGEST}, in m")
    if (width := thing_of(choice).width) > LARGEST * OPENING:
        raise ValueError(
            f"the {choice['shape']} is {width:.3f} m wide, too large for the jaws; it must be at most "
            f"{LARGEST * OPENING:.3f} m"
        )


def thing_of(choice: Mapping[str, Any]) -> Thing:
    """The thing of given sizes."""
    return SHAPES[choice["shape"]].make(**{name: choice[name] for name in SHAPES[choice["shape"]].sizes})


def draw_thing(choice: ShapeChoice, rng: np.random.Generator) -> Thing:
    """A thing of a shape, or of any, with sizes drawn where they are not given."""
    if isinstance(choice, Mapping):
        return thing_of(choice)
    drawn = SHAPES[choice or SHAPE_NAMES[rng.integers(len(SHAPE_NAMES))]]
    return drawn.make(**{name: rng.uniform(*bounds) for name, bounds in drawn.sizes.items()})
