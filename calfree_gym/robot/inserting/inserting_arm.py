"""The paper's arm with a peg in its gripper, and a plate with a hole before it."""

from __future__ import annotations

from typing import Any

from calfree_gym.robot.arms.movemaster import GRIPPER_POINT
from calfree_gym.robot.grasping.gripping_arm import GrippingArm
from calfree_gym.robot.grasping.jaws import AXIS, add_gripper, add_table
from calfree_gym.robot.inserting.peg import RADIUS, STICKS_OUT, add_peg, add_plate


class InsertingArm(GrippingArm):
    """Four motors turn J1-J3 and J5; the jaws are closed on a peg, whose end is the gripper point.

    Args:
        clearance: The hole's diameter less the peg's (m).
    """

    opening = RADIUS

    def __init__(self, clearance: float) -> None:
        self._hole = RADIUS + clearance / 2

    def furnish(self, spec: Any) -> None:
        """See `GrippingArm`: with shorter jaws, a peg and a plate."""
        add_gripper(spec, spec.body("gripper"), GRIPPER_POINT, beyond=-STICKS_OUT)
        spec.site("gripper_base").pos = GRIPPER_POINT - [AXIS, 0, 0]
        add_peg(spec, GRIPPER_POINT)
        add_table(spec)
        add_plate(spec, self._hole)
