"""The marks by which the gripper that can hold is seen: coloured jaws, and a ball at either edge.

The lower ends of the jaws have a colour each, their upper ends have another. Each is seen from nearly all
around, and the middle of what is seen of it is its own. The object is seen by its colour. Marks weigh nothing
and touch nothing.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from calfree_gym.robot.arms.marks import EMISSION
from calfree_gym.robot.grasping.jaws import EDGE, FINGERS, JAWS, PAD, RAIL, SLIDES
from calfree_gym.robot.line_of_sight import MARKS_GROUP

COLOURS = {
    "jaw_1": (0.90, 0.05, 0.90),
    "jaw_2": (0.10, 0.20, 0.95),
    "edge_1": (0.95, 0.85, 0.05),
    "edge_2": (0.05, 0.80, 0.85),
    "fingers": (0.95, 0.10, 0.05),
    "object": (0.05, 0.70, 0.25),
}
"""Red, green and blue of the marks: six hues, about 60 degrees apart."""
RADIUS = 0.010
"""Of the balls (m)."""
FINGER = np.array([0.018, 0.011, 0.006])
"""Half of an upper end's length along the gripper's axis, of its width, and of its thickness (m)."""
_SKIN = 0.0005
"""So much larger than a jaw's lower end is what colours it (m)."""


def add_marks(spec: Any, thing: tuple[str, ...]) -> None:
    """Colours the jaws and the thing, and adds a ball at either edge.

    Args:
        spec: Of the arm and its gripper; it is changed.
        thing: Names of the geoms that the thing consists of.
    """
    box, ball = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
    for name, colour in COLOURS.items():
        spec.add_material(name=f"mark_{name}", rgba=[*colour, 1], emission=EMISSION)
    for name, side in zip(JAWS, (1, -1), strict=True):
        jaw = spec.body(name)
        _add(jaw, name, box, spec.site(f"{name}_tip").pos, PAD * [1, 1, 2] + _SKIN)
        _add(jaw, "fingers", box, [FINGERS - SLIDES, 0, side * 3 * PAD[2]], FINGER)
    palm = spec.body("palm")
    for name in ("edge_1", "edge_2"):
        _add(palm, name, ball, spec.site(name).pos, [RADIUS, 0, 0])
    palm.add_geom(
        mujoco.MjSpec().default,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[RAIL, -EDGE, 0, RAIL, EDGE, 0],
        size=[0.0012, 0, 0],
        rgba=[0.2, 0.2, 0.2, 1],
        mass=0.0,
        contype=0,
        conaffinity=0,
    )
    for part in thing:
        spec.geom(part).material, spec.geom(part).rgba = "mark_object", [*COLOURS["object"], 1]


def _add(body: Any, mark: str, kind: Any, at: Any, size: Any) -> None:
    body.add_geom(
        mujoco.MjSpec().default,
        type=kind,
        pos=at,
        size=size,
        material=f"mark_{mark}",
        group=MARKS_GROUP,
        mass=0.0,
        contype=0,
        conaffinity=0,
    )
