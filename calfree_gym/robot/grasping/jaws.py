"""The gripper that can hold: two jaws that slide, on a wrist that gives way along the gripper's axis."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from calfree_gym.geometry import Array

STROKE = 0.042
"""By how much each jaw opens (m)."""
OPENING = 2 * STROKE
"""Between the open jaws (m)."""
GRIP = 30.0
"""Each jaw presses with this force (N)."""
GIVES_WAY = 0.045
"""The wrist gives way so far (m)."""
SPRING = 3_000.0
"""Of the wrist (N/m)."""
JAWS = ("jaw_1", "jaw_2")
BEYOND = 0.006
"""The pads end so far beyond the gripper point (m)."""
RAIL, SLIDES = 0.088, 0.096
"""From the hand to the middle of the rail, the gripper's base, and to where jaws slide on it (m)."""
FINGERS = 0.126
"""From the hand to the middle of the jaws' upper ends (m)."""
AXIS = 0.092
"""From the gripper point back to the gripper's base (m): the jaws' opening, and a little."""
PAD = np.array([0.020, 0.016, 0.004])
"""Half of a pad's length along the gripper's axis, of its width, and of its thickness (m)."""
EDGE = 0.045
"""From the gripper's axis to each of its edges' marks (m)."""
OF_GRIPPER, OF_SURFACES = 2, 1
"""Bits of what touches: the gripper touches surfaces, and not itself."""
HARD = {"solref": [0.02, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0]}
"""How contacts give way: within four steps of 5 ms. Measured: in half that time what slides on the table
bounces, with peaks of 400 N."""


def add_gripper(spec: Any, hand: Any, point: Array, beyond: float = BEYOND) -> None:
    """Replaces what is on a hand by a gripper that can hold, and adds its actuator.

    Args:
        spec: Of the arm; it is changed.
        hand: The body that the last joint turns about its x axis.
        point: Where in it the gripper point is (3,), on the axis.
        beyond: The pads end so far beyond that point (m).
    """
    plain = mujoco.MjSpec().default
    for geom in list(hand.geoms)[1:]:  # the flange stays
        spec.delete(geom)
    hand.explicitinertial = False
    palm = hand.add_body(plain, name="palm")
    palm.add_joint(
        plain,
        name="wrist_spring",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[1, 0, 0],
        stiffness=SPRING,
        damping=60,
        limited=True,
        range=[-GIVES_WAY, 0.005],
    )
    _add_box(palm, "palm_block", [0.045, 0, 0], [0.035, 0.024, 0.032], 0.3)
    _add_box(palm, "palm_rail", [RAIL, 0, 0], [0.008, 0.018, 0.055], 0.1)
    tip = point[0] + beyond
    for name, side in zip(JAWS, (1, -1), strict=True):
        jaw = palm.add_body(plain, name=name, pos=[SLIDES, 0, 0])
        jaw.add_joint(
            plain,
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0, 0, side],
            armature=0.2,
            damping=20,
        )
        length = tip - SLIDES
        finger, pad = length / 2, length - PAD[0]
        _add_box(jaw, f"{name}_finger", [finger, 0, side * 0.012], [finger, 0.008, 0.004], 0.05)
        box = _add_box(jaw, f"{name}_pad", [pad, 0, side * PAD[2]], PAD, 0.05)
        box.condim, box.priority = 4, 1
        jaw.add_site(plain, name=f"{name}_tip", pos=[pad, 0, side * 2 * PAD[2]], rgba=[0] * 4)
    palm.add_site(plain, name="gripper_point", pos=point, rgba=[0] * 4)
    palm.add_site(plain, name="gripper_base", pos=point - [AXIS, 0, 0], rgba=[0] * 4)
    for i, side in enumerate((1, -1)):
        palm.add_site(plain, name=f"edge_{i + 1}", pos=[RAIL, side * EDGE, 0], rgba=[0] * 4)
    equality = spec.add_equality(
        plain,
        name="jaws",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=JAWS[0],
        name2=JAWS[1],
    )
    equality.data[:5] = [0, 1, 0, 0, 0]
    actuator = spec.add_actuator(
        plain, name="M6", target=JAWS[0], trntype=mujoco.mjtTrn.mjTRN_JOINT, forcelimited=True
    )
    actuator.set_to_position(kp=6_000.0)
    actuator.forcerange = [-2 * GRIP, 2 * GRIP]


def _add_box(body: Any, name: str, place: Any, size: Any, mass: float) -> Any:
    return body.add_geom(
        mujoco.MjSpec().default,
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=place,
        size=size,
        mass=mass,
        rgba=[0.22, 0.23, 0.26, 1],
        contype=OF_GRIPPER,
        conaffinity=OF_SURFACES,
        condim=3,
        **HARD,
    )


def add_table(spec: Any) -> None:
    """Adds the table as the gripper touches it: a plane."""
    plain = mujoco.MjSpec().default
    spec.worldbody.add_geom(
        plain,
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[2, 2, 0.1],
        rgba=[0] * 4,
        contype=OF_SURFACES,
        conaffinity=OF_SURFACES | OF_GRIPPER,
        condim=3,
        friction=[0.6, 0.005, 0.0001],
        **HARD,
    )


def add_thing(spec: Any) -> None:
    """Adds a thing of two parts that lies on the table."""
    plain = mujoco.MjSpec().default
    thing = spec.worldbody.add_body(plain, name="object")
    thing.add_freejoint(name="object")
    for name in ("object_1", "object_2"):
        thing.add_geom(
            plain,
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.1, 0.1, 0.1],
            pos=[0.0, 0.1 * (name == "object_2"), 0.0],
            mass=0.05,
            rgba=[0.85, 0.45, 0.10, 1],
            contype=OF_SURFACES,
            conaffinity=OF_SURFACES,
            condim=3,
            **HARD,
        )
    thing.add_site(plain, name="object_point", rgba=[0] * 4)
    for name in ("axis_1", "axis_2"):  # compiled away from the origin, else MuJoCo leaves them there
        thing.add_site(plain, name=name, pos=[0.1, 0.1, 0.1], rgba=[0] * 4)
