"""An arm as a chain of joints before two cameras: where its points are seen, and how that changes with it.

Every joint turns about an axis, slides along one, or both: a twist, as far as its register says. Nothing else
is said of the arm.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calfree_gym.image import CAMERAS

from ..base.observation import POINTS, Array

_SMALL = 1e-2
"""Below such a square of an angle, power series are more exact than quotients (a guard)."""


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return rotation_and_jacobian(vector)[0]


def rotation_and_jacobian(vector: Array) -> tuple[Array, Array]:
    """Rotation matrices R (..., 3, 3), and their left Jacobians V: with the vector, R x turns by V d(vector).

    Source: Solà, Deray & Atchuthan 2018, "A micro Lie theory", equations 134 and 145.
    """
    cross, (first, second, third) = cross_matrix(vector), _factors(vector)
    squared = cross @ cross
    unit = np.eye(3)
    return unit + first * cross + second * squared, unit + second * cross + third * squared


def jacobian_derivative(vector: Array, slide: Array) -> Array:
    """Of V u (..., 3, 3) by the rotation vectors (..., 3), for vectors u (..., 3)."""
    first, second, third = _factors(vector)
    squares = _squares(vector)
    small = squares < _SMALL
    some = np.where(small, 1.0, squares)
    second_slope = np.where(small, -1 / 12 + squares / 180 - squares**2 / 6720, (first - 2 * second) / some)
    third_slope = np.where(small, -1 / 60 + squares / 1260 - squares**2 / 60480, (second - 3 * third) / some)
    cross = cross_matrix(vector)
    once = turned(cross, slide)
    twice = turned(cross, once)
    along = (vector * slide).sum(-1)[..., None, None]
    of_twice = along * np.eye(3) + _outer(vector, slide) - 2 * _outer(slide, vector)
    growing = _outer(second_slope[..., 0] * once + third_slope[..., 0] * twice, vector)
    return np.asarray(growing - second * cross_matrix(slide) + third * of_twice)


def cross_matrix(vector: Array) -> Array:
    """The matrices (..., 3, 3) that make cross products with vectors (..., 3)."""
    matrix = np.zeros((*vector.shape, 3))
    for row, column, component in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        matrix[..., row, column] = vector[..., component]
        matrix[..., column, row] = -vector[..., component]
    return matrix


def turned(matrices: Array, vectors: Array) -> Array:
    """Products (..., 3) of matrices (..., 3, 3) and vectors (..., 3)."""
    return np.asarray(matrices @ vectors[..., None])[..., 0]


def _outer(first: Array, second: Array) -> Array:
    return first[..., :, None] * second[..., None, :]


def _squares(vector: Array) -> Array:
    return np.asarray((vector * vector).sum(-1))[..., None, None]


def _factors(vector: Array) -> tuple[Array, Array, Array]:
    """Sin a / a, (1 - cos a) / a², (a - sin a) / a³ (..., 1, 1) for angles a."""
    squares = _squares(vector)
    small = squares < _SMALL
    some = np.where(small, 1.0, squares)
    angles = np.sqrt(some)
    first, second = np.sin(angles) / angles, (1 - np.cos(angles)) / some
    if not small.any():
        return first, second, (1 - first) / some
    return (
        np.where(small, 1 - squares / 6 * (1 - squares / 20 * (1 - squares / 42)), first),
        np.where(small, (1 - squares / 12 * (1 - squares / 30 * (1 - squares / 56))) / 2, second),
        np.where(small, (1 - squares / 20 * (1 - squares / 42 * (1 - squares / 72))) / 6, (1 - first) / some),
    )


CAMERA = 8
"""Numbers of a camera: the logarithm of its focal length in image units, a lens coefficient, the turn (3) of
the room about it that takes its axis to z, and where in the room it is (3)."""
TURN, PLACE = slice(2, 5), slice(5, 8)
"""Which of them are the turn and the place."""
NEAREST = 0.05
"""Points are taken to be at least so far before a camera (a guard: they are divided by it)."""
UNDISTORTIONS = 8
"""Passes that undo a lens (a guard: each leaves a fifth of the error or less)."""
PARALLEL = 1e-12
"""Added to the square of the sine between two rays (a guard: it is divided by)."""


def projected(cameras: Array, places: Array) -> Array:
    """Image points (..., 2) of places (..., 3) in the room, by cameras' numbers (..., 8)."""
    before = turned(rotation(cameras[..., TURN]), places - cameras[..., PLACE])
    flat = before[..., :2] / np.maximum(before[..., 2:], NEAREST)
    return np.asarray(np.exp(cameras[..., :1]) * flat * (1 + cameras[..., 1:2] * _squared(flat)))


def by_place(cameras: Array, places: Array) -> Array:
    """Derivatives of image points by places (..., 2, 3)."""
    turn = rotation(cameras[..., TURN])
    return np.asarray(_by_before(cameras, turned(turn, places - cameras[..., PLACE])) @ turn)


def by_camera(cameras: Array, places: Array) -> Array:
    """By cameras' numbers (..., 2, 8)."""
    turn, jacobian = rotation_and_jacobian(cameras[..., TURN])
    before = turned(turn, places - cameras[..., PLACE])
    flat = before[..., :2] / np.maximum(before[..., 2:], NEAREST)
    by_lens = np.exp(cameras[..., :1]) * flat * _squared(flat)
    by_focal = np.exp(cameras[..., :1]) * flat + cameras[..., 1:2] * by_lens
    by_before = _by_before(cameras, before)
    by_turn = -by_before @ cross_matrix(before) @ jacobian
    return np.concatenate([by_focal[..., None], by_lens[..., None], by_turn, -by_before @ turn], -1)


def _by_before(cameras: Array, before: Array) -> Array:
    """Derivatives of image points (..., 2, 3) by where points are before their cameras (..., 3)."""
    depths = np.maximum(before[..., 2:], NEAREST)
    flat = before[..., :2] / depths
    of_flat = np.zeros((*before.shape[:-1], 2, 3))
    of_flat[..., 0, 0] = of_flat[..., 1, 1] = 1 / depths[..., 0]
    of_flat[..., 2] = -flat / depths * (before[..., 2:] > NEAREST)
    return np.asarray(np.exp(cameras[..., :1, None]) * (_lens_derivatives(cameras, flat) @ of_flat))


class Triangulation:
    """Where two cameras see points: midway between the rays f of both, at least distances from them.

    So all Rᵀ (1 - f fᵀ / fᵀf) R (X - place) have a sum of 0.

    Attributes:
        places: X in the room (..., n, 3).

    Args:
        cameras: Of the left and the right camera (..., 2, 8).
        sensors: What they see (n, 4), in image units.
    """

    def __init__(self, cameras: Array, sensors: Array) -> None:
        numbers = np.moveaxis(cameras, -2, 0)[..., None, :]  # (2, ..., 1, 8)
        seen = np.moveaxis(sensors.reshape(-1, 2, 2), 1, 0)
        seen = seen.reshape(2, *[1] * (numbers.ndim - 3), -1, 2)
        self._cameras, self._places = numbers, numbers[..., PLACE]
        self._flat = _undistorted(numbers, seen * np.exp(-numbers[..., :1]))
        self._ahead = np.concatenate([self._flat, np.ones_like(self._flat[..., :1])], -1)
        self._lengths = _squared(self._ahead)[..., None]
        self._off_ray = np.eye(3) - self._ahead[..., :, None] * self._ahead[..., None, :] / self._lengths
        self._turns, self._jacobians = rotation_and_jacobian(numbers[..., TURN])
        self._backs = self._turns.swapaxes(-1, -2)
        curved = self._backs @ self._off_ray @ self._turns
        self._curved = curved.sum(0) + PARALLEL * np.eye(3)
        self.places = np.linalg.solve(self._curved, turned(curved, self._places).sum(0)[..., None])[..., 0]

    def derivatives(self) -> Array:
        """Of the places by all numbers of both cameras (..., n, 3, 16), as the sum stays 0."""
        ahead, unit = self._ahead[..., :, None], np.eye(3)
        before = turned(self._turns, self.places - self._places)[..., :, None]
        along = ahead.swapaxes(-1, -2) @ before / self._lengths
        left = (before - along * ahead)[..., 0]
        by_ahead = -along * unit - ahead @ before.swapaxes(-1, -2) / self._lengths
        by_ahead += 2 * along * ahead @ ahead.swapaxes(-1, -2) / self._lengths
        growth = _squared(self._flat)
        distorted = self._flat * (1 + self._cameras[..., 1:2] * growth)
        by_lens = -np.linalg.solve(
            _lens_derivatives(self._cameras, self._flat), np.stack([distorted, self._flat * growth], -1)
        )
        by_turn = (cross_matrix(left) - self._off_ray @ cross_matrix(before[..., 0])) @ self._jacobians
        by_numbers = np.concatenate([by_ahead[..., :2] @ by_lens, by_turn, -self._off_ray @ self._turns], -1)
        left_camera, right_camera = self._backs @ by_numbers
        return np.asarray(-np.linalg.solve(self._curved, np.concatenate([left_camera, right_camera], -1)))


def _undistorted(cameras: Array, distorted: Array) -> Array:
    flat = distorted
    for _ in range(UNDISTORTIONS):
        flat = distorted / (1 + cameras[..., 1:2] * _squared(flat))
    return flat


def _lens_derivatives(cameras: Array, flat: Array) -> Array:
    """Of what a lens makes of points (..., 2) at a focal length of one, by these (..., 2, 2)."""
    lens, unit = cameras[..., 1:2, None], np.eye(2)
    growth = 1 + lens * _squared(flat)[..., None]
    return np.asarray(growth * unit + 2 * lens * flat[..., :, None] * flat[..., None, :])


def _squared(vectors: Array) -> Array:
    """Squares of their lengths (..., 1)."""
    return np.asarray((vectors * vectors).sum(-1, keepdims=True))


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
