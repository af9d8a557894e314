"""The knowledge base `memory`: every look of every trial, and nothing but looks.

Gripper points depend on the registers. Object points depend on the registers, and on where the object is: on
where it is seen from home. So it does not matter which motors move the cameras, the gripper or both, nor that
many registers lead to one place.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from ..base.storage import prefixed, under
from ..jacobian import Slopes
from ..servo.image_model.smooth_points import SmoothPoints
from .arm_change import ArmChange
from .camera_change import CameraChange
from .home_view import HomeView
from .kept_looks import KeptLooks
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
        looks: So many looks are kept, at the gripper and at the object. Choice: 700 are no better with seven
            motors.
    """

    prior_knowledge: ClassVar = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE})

    def __init__(self, motors: int, looks: int = 300) -> None:
        self.looks = check_number("looks", looks, least=10, whole=True)
        self.motors = motors
        self.gripper = KeptLooks(motors, motors, looks)
        self.object = KeptLooks(motors + 4, motors, looks)

    def __repr__(self) -> str:
        return f"Remembered(looks={self.looks})"

    def points(self, home: Array | None, noise_px: float, start: Slopes | None = None) -> SmoothPoints:
        """What is known of gripper and object points.

        Args:
            home: Where the object is seen from home (4,), noisily; None where it is not: then nothing is
                known of it.
            noise_px: Standard deviation of an image coordinate.
            start: The Jacobian as it usually is.
        """
        of_object = None if home is None else (self.object.function, home.reshape(2, 2))
        return SmoothPoints.remembered(self.gripper.function, of_object, noise_px, start)

    def learn(self, pairs: Pairs) -> None:
        """Takes in what was seen."""
        self.gripper.add(*self._gripper_looks(pairs))
        self.object.add(*self._object_looks(pairs))

    def learn_anew(self, pairs: Pairs) -> float:
        """As `learn`, where points may be less smooth than they were thought to be.

        Returns:
            The logarithm of how probable pairs are, given what was known before.
        """
        return self.gripper.add_and_refit(*self._gripper_looks(pairs)) + self.object.add_and_refit(
            *self._object_looks(pairs)
        )

    def _gripper_looks(self, pairs: Pairs) -> tuple[Array, Array, Array]:
        """Places (n, m), points (n, 2, 2) and variances (n,)."""
        noise = np.square(pairs.noise_px * IMAGE_UNIT)
        return pairs.registers, pairs.sensors.reshape(-1, 2, 2), noise

    def _object_looks(self, pairs: Pairs) -> tuple[Array, Array, Array]:
        """Places (n, m + 4), points from the home view, which is noisy, too (n, 2, 2), and variances (n,)."""
        seen = pairs.only(pairs.with_object)
        noise = np.square(seen.noise_px * IMAGE_UNIT)
        places = np.column_stack([seen.registers, seen.homes])
        return places, (seen.objects - seen.homes).reshape(-1, 2, 2), 2 * noise

    def map(self, changes: Sequence[CameraChange] | Sequence[ArmChange]) -> None:
        """Maps all that is stored by changes, at least one."""
        deviations = reduce(np.hypot, [change.deviation_px * IMAGE_UNIT for change in changes])
        arm = changes[0]  # cameras, of which there may be two, leave registers as they are
        gripper, object_, motors = self.gripper.function.looks, self.object.function, self.motors
        if len(self.gripper):
            sensors = _changed(changes, gripper.points.reshape(-1, 4)).reshape(-1, 2, 2)
            self.gripper.map(arm.registers(gripper.places), sensors, deviations)
        if len(self.object):
            registers, homes = np.split(object_.looks.places, [motors], axis=1)
            seen = _changed(changes, object_.looks.points.reshape(-1, 4) + homes)
            at_home = np.column_stack([np.tile(arm.old_home(motors), (len(homes), 1)), homes])
            homes = _changed(changes, homes + object_.at_all(at_home)[0].reshape(-1, 4))
            self.object.map(
                np.column_stack([arm.registers(registers), homes]),
                (seen - homes).reshape(-1, 2, 2),
                deviations,
            )

    def errors(self, pairs: Pairs) -> tuple[Array, Array]:
        """How far gripper and object are seen from where they should be; zero where the object is not seen.

        Returns:
            Errors (2, n, 2) of gripper and object in each camera, in pixels, and the same in units of their
            standard deviation.
        """
        gripper, gripper_variances, _ = self.gripper_errors(pairs)
        object_, object_variances, _ = self.object_errors(pairs)
        errors_px = np.linalg.norm([gripper, object_], axis=-1) / IMAGE_UNIT
        return errors_px, errors_px * IMAGE_UNIT / np.sqrt([gripper_variances, object_variances])

    def gripper_errors(self, pairs: Pairs, old: Array | None = None) -> tuple[Array, Array, Array]:
        """How far the gripper is seen from where it should be, in image units.

        Args:
            pairs: What was seen.
            old: The registers (n, m) that led there, where others do now.

        Returns:
            Errors (n, 2, 2), their variances (n, 2), and how points change with registers (n, 2, 2, m).
        """
        points, variances, slopes = self.gripper.function.at_all(pairs.registers if old is None else old)
        noise = np.square(pairs.noise_px * IMAGE_UNIT)
        return pairs.sensors.reshape(-1, 2, 2) - points, variances + noise[:, None], slopes

    def object_errors(self, pairs: Pairs, old: Array | None = None) -> tuple[Array, Array, Array]:
        """The same of the object; nothing where it was not seen, and what is known of it says nothing."""
        points, variances, slopes = self.object.function.at_all(
            np.column_stack([pairs.registers if old is None else old, pairs.homes])
        )
        errors = (pairs.objects - pairs.homes).reshape(-1, 2, 2) - points
        return (
            np.where(np.isfinite(errors), errors, 0.0),
            variances + 2 * np.square(pairs.noise_px * IMAGE_UNIT)[:, None],
            slopes,
        )

    def agrees_with(self, pairs: Pairs, other: Self) -> bool:
        """Whether most pairs are seen where they should be, and on average nearer there than by `other`.

        Most may agree with both: a motor that has reversed shows only where it has moved.
        """
        errors_px, by_other_px = (each.errors(pairs)[0].max(0) for each in (self, other))
        agrees = np.median(errors_px) < HomeView.SIGMAS * pairs.noise_px.mean()
        return bool(agrees and errors_px.mean() < by_other_px.mean())

    def evidence(self, pairs: Pairs) -> float:
        """The logarithm of how probable pairs are, given what is known."""
        return self.gripper.evidence(*self._gripper_looks(pairs)) + self.object.evidence(
            *self._object_looks(pairs)
        )

    def copy(self) -> Self:
        """A second one that knows the same."""
        other = copy.copy(self)
        other.gripper, other.object = copy.copy(self.gripper), copy.copy(self.object)
        return other

    def nothing(self) -> Self:
        """A second one that knows nothing."""
        return type(self)(self.motors, self.looks)

    def copy_of(self, arrays: Arrays) -> Self:
        """A second one that knows what `arrays` returned."""
        other = self.nothing()
        other.restore(arrays)
        return other

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        return prefixed("gripper", self.gripper.arrays()) | prefixed("object", self.object.arrays())

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        self.gripper.restore(under("gripper", arrays))
        self.object.restore(under("object", arrays))


def _changed(changes: Sequence[CameraChange] | Sequence[ArmChange], sensors: Array) -> Array:
    """Sensor vectors (n, 4) after all changes: each camera's by what both cameras saw before any of them."""
    found = sensors
    for change in changes:
        changed = change.sensors(sensors)
        found = np.where(changed != sensors, changed, found)
    return found
