"""The peg between the jaws, and the plate with its hole."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from calfree_gym.robot.grasping.jaws import HARD, OF_GRIPPER, OF_SURFACES, SPRING

RADIUS = 0.008
"""Of the peg (m). Choice: a dowel of 16 mm, which the jaws hold."""
STICKS_OUT = 0.045
"""The peg ends so far beyond the jaws (m). Choice: twice as deep as it is to go in, and a little."""
CHAMFER, NARROWER = 0.003, 0.0008
"""The peg's end narrows over this length, by so much of its radius (m): a dowel's chamfer, 3 mm at 15 degrees
(ISO 2338)."""
YIELDS = 0.003
"""The grip gives way to the side so far (m). Choice: that of a compliance for assembly (Whitney 1982)."""
DAMPING = 60.0
"""Of the grip, to the side (N s/m): that of the wrist along its axis."""
ARMATURE = 0.2
"""Of the grip, to the side (kg): that of the jaws. So it swings slowly enough for substeps of 5 ms."""
FRICTION = 0.2
"""Of steel on steel, hardly greased."""
THICKNESS = 0.004
"""Of the plate (m). Choice: thin, so that the hole does not guide the peg."""
PLATE = 0.050
"""Of the plate's middle ring, from the hole's axis to its edge (m)."""
SIDES = 24
"""The hole is a ring of so many boxes; its corners are wider than the hole by 0.9 %. Choice: by less than a
sixth of the smallest clearance asked for."""
RIM = 0.040
"""From the hole's centre to each of the plate's points (m). Choice: beyond the peg, near the edge."""
RIMS = tuple(f"rim_{i}" for i in range(1, 5))
"""Names of the plate's points."""


def add_peg(spec: Any, point: Any) -> None:
    """Puts a peg between the jaws, which gives way to the side as the wrist does along the axis.

    Args:
        spec: Of the arm and its gripper; it is changed.
        point: Where on the gripper the peg's end is (3,), on the gripper's axis.
    """
    plain, palm = mujoco.MjSpec().default, spec.body("palm")
    spec.delete(spec.site("gripper_point"))
    peg = palm.add_body(plain, name="peg", pos=point)
    for name, axis in (("grip_1", [0, 1, 0]), ("grip_2", [0, 0, 1])):
        peg.add_joint(
            plain,
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            stiffness=SPRING,
            damping=DAMPING,
            armature=ARMATURE,
            limited=True,
            range=[-YIELDS, YIELDS],
        )
    length = STICKS_OUT + 0.03  # between the jaws, too
    skin = {
        "contype": OF_GRIPPER,
        "conaffinity": OF_SURFACES,
        "condim": 3,
        "friction": [FRICTION, 0.005, 0.0001],
        "priority": 1,
        "rgba": [0.75, 0.76, 0.80, 1],
        **HARD,
    }
    peg.add_geom(
        plain,
        name="peg",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[-length, 0, 0, -CHAMFER, 0, 0],
        size=[RADIUS, 0, 0],
        mass=0.1,
        **skin,
    )
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    ring = np.stack([np.zeros(SIDES), np.cos(angles), np.sin(angles)], -1)
    ends = [RADIUS * ring - [CHAMFER, 0, 0], (RADIUS - NARROWER) * ring]
    spec.add_mesh(name="nose", uservert=np.concatenate(ends).ravel())
    peg.add_geom(plain, name="nose", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="nose", mass=0.0, **skin)
    peg.add_site(plain, name="gripper_point", rgba=[0] * 4)


def add_plate(spec: Any, radius: float) -> None:
    """Adds a plate in the room, whose frame is at the centre of its hole, on the upper side, z upwards.

    Args:
        spec: Of the scene; it is changed.
        radius: Of the hole (m).
    """
    plain = mujoco.MjSpec().default
    plate = spec.worldbody.add_body(plain, name="object", pos=[0.4, 0, 0.1])
    half, wide = (PLATE - radius) / 2, PLATE * np.tan(np.pi / SIDES)
    for i in range(SIDES):
        angle = 2 * np.pi * i / SIDES
        middle = (radius + half) * np.array([np.cos(angle), np.sin(angle)])
        plate.add_geom(
            plain,
            name=f"plate_{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[*middle, -THICKNESS / 2],
            quat=[np.cos(angle / 2), 0, 0, np.sin(angle / 2)],
            size=[half, wide, THICKNESS / 2],
            rgba=[0.20, 0.45, 0.70, 1],
            contype=OF_SURFACES,
            conaffinity=OF_SURFACES,
            condim=3,
            **HARD,
        )
    plate.add_site(plain, name="object_point", rgba=[0] * 4)
    for name, (x, y) in zip(RIMS, ((RIM, 0), (-RIM, 0), (0, RIM), (0, -RIM)), strict=True):
        plate.add_site(plain, name=name, pos=[x, y, 0], rgba=[0] * 4)
