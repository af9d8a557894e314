"""The knowledge base `memory`: every look of every trial, and nothing but looks.

Gripper points depend on the registers. Object points depend on the registers, and on where the object is: on
where it is seen from home. So it does not matter which motors move the cameras, the gripper or both, nor that
many registers lead to one place.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number
from ..base.observation import Array, camera_lengths_px
from ..base.prior_knowledge import PriorKnowledge
from ..base.storage import prefixed, under
from ..servo.smooth_points import SmoothPoints
from .arm_change import ArmChange
from .camera_change import CameraChange
from .home_view import HomeView
from .looks import Looks
from .pairs import Pairs

Arrays = Mapping[str, NDArray[Any]]


class Remembered:
    """What was seen in all trials.

    Attributes:
        gripper: Looks at the gripper, by registers.
        object: Looks at the object, by registers and by where it is seen from home: how far it is seen from
            there.

    Args:
        motors: Number of registers m.
        looks: So many looks are kept, at the gripper and at the object. Choice: in arms of three motors 300 are
            no better than 200, and a motion takes longer.
    """

    prior_knowledge: ClassVar = frozenset(
        {PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE, PriorKnowledge.WORD_LIMIT}
    )

    def __init__(self, motors: int, looks: int = 300) -> None:
        self.looks = check_number("looks", looks, least=10, whole=True)
        self.motors = motors
        self.gripper = Looks(motors, motors, looks)
        self.object = Looks(motors + 4, motors, looks)

    def __repr__(self) -> str:
        return f"Remembered(looks={self.looks})"

    def points(self, home: Array) -> SmoothPoints:
        """What is known of gripper and object points, of an object seen from home at `home` (4,)."""
        return SmoothPoints.remembered(self.gripper.function, self.object.function, home.reshape(2, 2))

    def learn(self, pairs: Pairs) -> None:
        """Takes in what was seen."""
        noise = np.square(pairs.noise_px * IMAGE_UNIT)
        self.gripper.add(pairs.registers, pairs.sensors.reshape(-1, 2, 2), noise)
        shown = np.isfinite(pairs.objects).all(1) & pairs.registers.any(1)
        seen = pairs.only(shown)
        places = np.column_stack([seen.registers, seen.homes])
        self.object.add(places, (seen.objects - seen.homes).reshape(-1, 2, 2), 2 * noise[shown])

    def map(self, changes: Sequence[CameraChange] | Sequence[ArmChange]) -> None:
        """Maps all that is stored by each of the changes."""
        for change in changes:
            variances = np.square(change.deviation_px * IMAGE_UNIT)
            gripper, object_, motors = self.gripper.function, self.object.function, self.motors
            if len(self.gripper):
                sensors = change.sensors(gripper.points.reshape(-1, 4)).reshape(-1, 2, 2)
                self.gripper.replace(change.registers(gripper.places), sensors, gripper.variances + variances)
            if len(self.object):
                registers, homes = object_.places[:, :motors], object_.places[:, motors:]
                seen = change.sensors(object_.points.reshape(-1, 4) + homes)
                at_new_home = np.column_stack([np.tile(change.old_home(motors), (len(homes), 1)), homes])
                homes = change.sensors(homes + object_.at_all(at_new_home)[0].reshape(-1, 4))
                self.object.replace(
                    np.column_stack([change.registers(registers), homes]),
                    (seen - homes).reshape(-1, 2, 2),
                    object_.variances + variances,
                )

    def views(self, registers: Array) -> tuple[Array, Array]:
        """What should be seen of the gripper at registers (k, m): sensors (k, 4), and variances (k, 2)."""
        points, variances, _ = self.gripper.function.at_all(registers)
        return points.reshape(-1, 4), variances

    def errors(self, pairs: Pairs) -> tuple[Array, Array]:
        """How far the gripper is seen from where it should be.

        Returns:
            Errors (n, 2) in each camera, in pixels, and the same in units of their standard deviation.
        """
        expected, variances = self.views(pairs.registers)
        errors_px = camera_lengths_px(pairs.sensors - expected)
        return errors_px, errors_px / np.sqrt(variances / IMAGE_UNIT**2 + pairs.noise_px[:, None] ** 2)

    def agrees_with(self, pairs: Pairs, other: Self) -> bool:
        """Whether most pairs are seen where they should be, and on average nearer there than by `other`.

        Most may agree with both: a motor that has reversed shows only where it has moved.
        """
        (errors_px, _), (by_other_px, _) = self.errors(pairs), other.errors(pairs)
        agrees = np.median(errors_px) < HomeView.SIGMAS * pairs.noise_px.mean()
        return bool(agrees and errors_px.mean() < by_other_px.mean())

    def copy_of(self, arrays: Arrays) -> Self:
        """A second one that knows what `arrays` returned."""
        other = copy.copy(self)
        other.gripper = Looks(self.motors, self.motors, self.looks)
        other.object = Looks(self.motors + 4, self.motors, self.looks)
        other.restore(arrays)
        return other

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        return prefixed("gripper", self.gripper.arrays()) | prefixed("object", self.object.arrays())

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        self.gripper.restore(under("gripper", arrays))
        self.object.restore(under("object", arrays))
