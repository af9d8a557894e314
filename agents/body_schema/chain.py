"""An arm as a chain of joints before two cameras: where its points are seen, and how that changes with it.

Every joint turns about an axis, slides along one, or both: a twist, as far as its register says. Nothing else
is said of the arm.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calfree_gym.image import CAMERAS

from ..base.observation import POINTS, Array
from .pinholes import (
    CAMERA,
    TURN,
    Triangulation,
    by_camera,
    by_place,
    cross_matrix,
    jacobian_derivative,
    projected,
    rotation_and_jacobian,
    turned,
)

JOINT = 9
"""Numbers of a joint: how far it turns about x, y, z and slides along them for a register of one (6), at
which register it stood when the others were told (1), and what the register's square and cube add (2)."""


class Twists:
    """What joints do at registers: a point x of what they move comes to R x + s.

    Attributes:
        turns: R (..., 3, 3).
        shifts: s (..., 3).

    Args:
        joints: Their numbers (..., 9).
        registers: One of each (...).
    """

    def __init__(self, joints: Array, registers: Array) -> None:
        self._axes, self._ways, self._registers = joints[..., :3], joints[..., 3:6], registers
        self._square, self._cube = joints[..., 7], joints[..., 8]
        by = joints[..., 6] + registers + self._square * registers**2 + self._cube * registers**3
        self._by = by[..., None]
        self._turn, self._slide = self._axes * self._by, self._ways * self._by
        self.turns, self._jacobian = rotation_and_jacobian(self._turn)
        self.shifts = turned(self._jacobian, self._slide)

    def by_registers(self, places: Array) -> Array:
        """Derivatives of R x + s by registers (..., 3, 1), where R x is at `places` (..., 3)."""
        per_register = 1 + 2 * self._square * self._registers + 3 * self._cube * self._registers**2
        return (self._further(places) * per_register[..., None])[..., None]

    def by_numbers(self, places: Array) -> Array:
        """By the joints' numbers (..., 3, 9)."""
        by, registers = self._by[..., None], self._registers
        by_axis = by * (jacobian_derivative(self._turn, self._slide) - cross_matrix(places) @ self._jacobian)
        by_way, further = by * self._jacobian, self._further(places)
        powers = np.stack([np.ones_like(registers), registers**2, registers**3], -1)[..., None, :]
        return np.concatenate([by_axis, by_way, further[..., None] * powers], -1)

    def _further(self, places: Array) -> Array:
        """What they move, for each rad or unit of length further (..., 3)."""
        return turned(cross_matrix(self._axes), places) + turned(self.turns, self._ways)


GRIPPER = 3
"""Numbers of the gripper point: where it is at home."""


@dataclass(frozen=True)
class JointChain:
    """Which numbers make an arm and its cameras: `size` of them.

    Attributes:
        motors: m. They are in the order in which they follow each other from the base.
        mounts: How many of them, from the base, move the left and the right camera.
    """

    motors: int
    mounts: tuple[int, int]

    @property
    def size(self) -> int:
        """P."""
        return self.cameras.stop

    @property
    def gripper(self) -> slice:
        """Where in the vector of all numbers the gripper's are."""
        return slice(JOINT * self.motors, JOINT * self.motors + GRIPPER)

    @property
    def cameras(self) -> slice:
        """Where those of the cameras are."""
        return slice(self.gripper.stop, self.gripper.stop + len(CAMERAS) * CAMERA)

    def joint(self, motor: int) -> slice:
        """Where those of a joint are."""
        return slice(JOINT * motor, JOINT * (motor + 1))

    def camera(self, camera: int) -> slice:
        """Where those of a camera are."""
        return slice(self.cameras.start + CAMERA * camera, self.cameras.start + CAMERA * (camera + 1))

    def turn(self, camera: int) -> slice:
        """Where those are that tell how a camera is turned."""
        begin = self.camera(camera).start
        return slice(begin + TURN.start, begin + TURN.stop)


class Views:
    """What a chain shows of gripper and object; chains of other numbers at once, where these have more axes.

    Attributes:
        points: (..., n, 4, 2), in image units: gripper left, right, object left, right.

    Args:
        chain: Which numbers mean what.
        numbers: All of them (..., p).
        registers: (n, m).
        homes: The object's sensor vectors as seen from home (n, 4), or one (1, 4): they tell where it is.
    """

    def __init__(self, chain: JointChain, numbers: Array, registers: Array, homes: Array) -> None:
        self._chain = chain
        several, (count, motors) = numbers.shape[:-1], registers.shape
        joints = numbers[..., : chain.gripper.start].reshape(*several, motors, 1, JOINT)
        self._joints = np.moveaxis(joints, -3, 0)
        self._registers = registers.T.reshape(motors, *[1] * len(several), count)
        self._cameras = numbers[..., chain.cameras].reshape(*several, len(CAMERAS), CAMERA)
        self._twists = Twists(self._joints, self._registers)
        moves = list(zip(self._twists.turns, self._twists.shifts, strict=True))
        places = (*several, count, 3)
        self._gripper = [np.broadcast_to(numbers[..., None, chain.gripper], places)]
        for turn, shift in reversed(moves):  # by ever more of the last joints
            self._gripper.append(turned(turn, self._gripper[-1]) + shift)
        self._seen_from_home = Triangulation(self._cameras, homes)
        self._object = [np.broadcast_to(self._seen_from_home.places, places)]
        for turn, shift in moves[: max(chain.mounts)]:  # as a camera sees it that ever more joints move
            self._object.append(turned(turn.swapaxes(-1, -2), self._object[-1] - shift))
        self.points = np.empty((*several, count, POINTS, 2))
        for point, camera, place in self._seen(self._gripper, self._object):
            self.points[..., point, :] = projected(self._camera(camera), place)

    def by_registers(self) -> Array:
        """Derivatives of the points by registers (..., n, 4, 2, m)."""
        motors = self._chain.motors
        still = np.zeros((*self.points.shape[:-2], 3, motors))
        columns = [slice(joint, joint + 1) for joint in range(motors)]
        of_places = self._of_places(still, still, Twists.by_registers, columns)
        return self._of_points(*of_places)

    def by_numbers(self) -> Array:
        """By all numbers (..., n, 4, 2, p)."""
        chain = self._chain
        gripper = np.zeros((*self.points.shape[:-2], 3, chain.size))
        object_ = np.zeros_like(gripper)
        gripper[..., chain.gripper] = np.eye(GRIPPER)
        object_[..., chain.cameras] = self._seen_from_home.derivatives()
        columns = [chain.joint(joint) for joint in range(chain.motors)]
        by_all = self._of_points(*self._of_places(gripper, object_, Twists.by_numbers, columns))
        for point, camera, place in self._seen(self._gripper, self._object):
            by_all[..., point, :, chain.camera(camera)] += by_camera(self._camera(camera), place)
        return by_all

    def _of_places(
        self,
        gripper: Array,
        object_: Array,
        of_joints: Callable[[Twists, Array], Array],
        columns: list[slice],
    ) -> tuple[list[Array], list[Array]]:
        """Derivatives (..., n, 3, k) of gripper and object, moved by no joint, by one, by two and so on.

        Args:
            gripper: Those of the gripper where no joint has moved it.
            object_: Those of the object.
            of_joints: Those by the joints themselves (joints, ..., n, 3, of each), where they move points.
            columns: Which of k these are.
        """
        turns, shifts, behind = self._twists.turns, self._twists.shifts, len(self._object) - 1
        of_gripper, of_object = [gripper], [object_]
        by_joints = of_joints(self._twists, np.stack(self._gripper[:0:-1]) - shifts)
        for joint in reversed(range(len(columns))):
            gripper = turns[joint] @ gripper
            gripper[..., columns[joint]] += by_joints[joint]
            of_gripper.append(gripper)
        if behind:
            moving = Twists(self._joints[:behind], self._registers[:behind])
            by_joints = of_joints(moving, np.stack(self._object[:behind]) - shifts[:behind])
        for joint in range(behind):
            back = turns[joint].swapaxes(-1, -2)
            object_ = back @ object_
            object_[..., columns[joint]] -= back @ by_joints[joint]
            of_object.append(object_)
        return of_gripper, of_object

    def _of_points(self, of_gripper: list[Array], of_object: list[Array]) -> Array:
        """Derivatives of the points (..., n, 4, 2, k), from those of the places."""
        derivatives = np.empty((*self.points.shape, of_gripper[0].shape[-1]))
        places = self._seen(self._gripper, self._object)
        for (point, camera, place), (_, _, of_place) in zip(
            places, self._seen(of_gripper, of_object), strict=True
        ):
            derivatives[..., point, :, :] = by_place(self._camera(camera), place) @ of_place
        return derivatives

    def _seen(self, gripper: list[Array], object_: list[Array]) -> Iterator[tuple[int, int, Array]]:
        """Point, camera, and what of a list belongs to the joints that move the one before the other."""
        for camera, mount in enumerate(self._chain.mounts):
            yield camera, camera, gripper[self._chain.motors - mount]
            yield len(CAMERAS) + camera, camera, object_[mount]

    def _camera(self, camera: int) -> Array:
        """Its numbers (..., 1, 8)."""
        return self._cameras[..., camera, None, :]
