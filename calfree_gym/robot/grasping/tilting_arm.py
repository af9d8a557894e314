"""The arm that grasps, with its wrist's tilt (J4) as a motor of its own: five joints (paper, section 3.5)."""

from __future__ import annotations

import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.robot.arms.movemaster import JOINT_LIMITS, LIMIT_MARGIN, Movemaster
from calfree_gym.robot.arms.robot import Furnish, Mounts, Scene
from calfree_gym.robot.grasping.gripping_arm import TURN, GrippingArm

TILT = TURN
"""Radians from home to register 1 of the wrist's tilt, at gain 1: as of its turn."""
HOME = np.radians([0.0, 55.0, -80.0, -65.0, 0.0])
"""J1-J5 at registers zero: as built the gripper points straight down, above where things are held."""
HOLDER = np.array([5.0, 5.0, 5.0, 0.2, 0.2, 0.2])
"""What holds a thing in the air gives way to more than this (N, and N m). Choice: more than the heaviest
weighs, and far less than the jaws press."""

FIRM = 0.9999
"""Impedance of its friction. Measured: so things sink by 0.05 mm in a trial; by default, 11 mm a second."""


class TiltingArm(GrippingArm):
    """Five motors turn J1-J5. Nothing keeps the gripper vertical."""

    motors = (*Movemaster.motors, "wrist_tilt", "wrist_turn")
    joints = ("J1", "J2", "J3", "J4", "J5")
    slides = np.zeros(5, bool)
    home = HOME
    span = np.append(Movemaster.span, [TILT, TURN])
    stops = np.vstack([JOINT_LIMITS, np.radians([[-180, 180]])])
    stop_margin = np.full(5, 0.01)
    lowest = np.append(Movemaster.lowest, [JOINT_LIMITS[3, 0] + LIMIT_MARGIN, -np.pi / 2])
    highest = np.append(Movemaster.highest, [HOME[3] + np.pi / 2, np.pi / 2])

    def rest(self, zeros: Array) -> Array:
        """See `Robot`: nothing; the pitch of a gripper that points straight down."""
        return np.array([-np.pi / 2])

    def angles(self, positions: Array, rest: Array) -> Array:
        """See `Robot`: J1-J5 in rad, which are the motors' own."""
        return positions.copy()

    def positions_at(self, points: Array, rest: Array, lengths: Array) -> Array:
        """See `GrippingArm`: (k, 5), with the gripper at the pitch `rest` (1,)."""
        waist, rise, elbow, turn = super().positions_at(points, rest, lengths).T
        return np.stack([waist, rise, elbow, rest[0] - rise - elbow, turn], -1)

    def scene(self, mounts: Mounts, furnish: Furnish | None = None) -> Scene:
        """See `GrippingArm`: the thing is held in the air."""
        scene = super().scene(mounts, furnish)
        first = int(scene.model.joint("object").dofadr[0])
        held = slice(first, first + len(HOLDER))
        scene.model.dof_frictionloss[held], scene.model.dof_solimp[held, :2] = HOLDER, FIRM
        return scene
