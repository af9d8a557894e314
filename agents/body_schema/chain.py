"""An arm as a chain of joints before two cameras: where its points are seen, and how that changes with it.

Every joint turns about an axis, slides along one, or both: a twist, as far as its register says. Nothing else
is said of the arm.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calfree_gym.image import CAMERAS

from ..base.observation import POINTS, Array

_SMALL = 1e-2
"""Below such a square of an angle, power series are more exact than quotients (a guard)."""


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return Rotations(vector).matrices


class Rotations:
    """What rotation vectors do.

    Source: Solà, Deray & Atchuthan 2018, "A micro Lie theory", equations 134 and 145.

    Attributes:
        matrices: R (..., 3, 3).
        jacobians: Their left Jacobians V (..., 3, 3): with the vector, R x turns by V d(vector).

    Args:
        vector: Rotation vectors (..., 3).
    """

    def __init__(self, vector: Array) -> None:
        self._vector, self._cross, self._squares = vector, cross_matrix(vector), _squares(vector)
        self._factors = first, second, third = _factors(self._squares)
        squared, unit = self._cross @ self._cross, np.eye(3)
        self.matrices = unit + first * self._cross + second * squared
        self.jacobians = unit + second * self._cross + third * squared

    def jacobian_derivative(self, slide: Array) -> Array:
        """Of V u (..., 3, 3) by the rotation vectors, for vectors u (..., 3)."""
        vector, cross, squares = self._vector, self._cross, self._squares
        first, second, third = self._factors
        small = squares < _SMALL
        some = np.where(small, 1.0, squares)
        second_slope = np.where(
            small, -1 / 12 + squares / 180 - squares**2 / 6720, (first - 2 * second) / some
        )
        third_slope = np.where(
            small, -1 / 60 + squares / 1260 - squares**2 / 60480, (second - 3 * third) / some
        )
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


def _factors(squares: Array) -> tuple[Array, Array, Array]:
    """Sin a / a, (1 - cos a) / a², (a - sin a) / a³ (..., 1, 1) for angles a of these squares."""
    turns = np.sqrt(squares) / (2 * np.pi)
    first, second = np.sinc(2 * turns), np.sinc(turns) ** 2 / 2
    small = squares < _SMALL
    series = (1 - squares / 20 * (1 - squares / 42 * (1 - squares / 72))) / 6
    return first, second, np.where(small, series, (1 - first) / np.where(small, 1.0, squares))


CAMERA = 8
"""Numbers of a camera: the logarithm of its focal length in image units, a lens coefficient, the turn (3) of
the room about it that takes its axis to z, and where in the room it is (3)."""
TURN, PLACE = slice(2, 5), slice(5, 8)
"""Which of them are the turn and the place."""
NEAREST = 0.05
"""Points are taken to be at least so far before a camera (a guard: they are divided by it)."""
UNDISTORTIONS = 8
"""Passes that undo a lens (a guard: each leaves a fifth of the error or less)."""
FOLD = 1e-6
"""A lens that turns back what is farther out moves points by this, at least (a guard: it is divided by)."""
PARALLEL = 1e-12
"""Added to the square of the sine between two rays (a guard: it is divided by)."""


class Projection:
    """What cameras see of places.

    Attributes:
        points: Image points (..., 2).

    Args:
        cameras: Their numbers (..., 8).
        places: In the room (..., 3).
    """

    def __init__(self, cameras: Array, places: Array) -> None:
        self._cameras, self._focal = cameras, np.exp(cameras[..., :1])
        rotations = Rotations(cameras[..., TURN])
        self._turns, self._jacobians = rotations.matrices, rotations.jacobians
        self._before = turned(self._turns, places - cameras[..., PLACE])
        self._flat = self._before[..., :2] / np.maximum(self._before[..., 2:], NEAREST)
        self._by_lens = self._focal * self._flat * _squared(self._flat)
        self.points = self._focal * self._flat + cameras[..., 1:2] * self._by_lens

    def by_place(self) -> Array:
        """Derivatives of image points by places (..., 2, 3)."""
        return self._by_before @ self._turns

    def by_camera(self) -> Array:
        """By cameras' numbers (..., 2, 8)."""
        by_turn = -self._by_before @ cross_matrix(self._before) @ self._jacobians
        parts = self.points[..., None], self._by_lens[..., None], by_turn, -self.by_place()
        return np.concatenate(parts, -1)

    @cached_property
    def _by_before(self) -> Array:
        """By where places are before their cameras (..., 2, 3)."""
        before, flat = self._before, self._flat
        of_flat = np.zeros((*before.shape[:-1], 2, 3))
        of_flat[..., 0, 0] = of_flat[..., 1, 1] = 1
        of_flat[..., 2] = -flat * (before[..., 2:] > NEAREST)
        of_flat *= (self._focal / np.maximum(before[..., 2:], NEAREST))[..., None]
        return np.asarray(_lens_derivatives(self._cameras, flat) @ of_flat)


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
        rotations = Rotations(numbers[..., TURN])
        self._turns, self._jacobians = rotations.matrices, rotations.jacobians
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
        growth, lens = _squared(self._flat), self._cameras[..., 1:2]
        outwards = 1 + 3 * lens * growth  # what moves out by 1 before a lens moves out so far behind it
        outwards = np.where(np.abs(outwards) < FOLD, FOLD, outwards)
        by_lens = -self._flat[..., None] * np.concatenate([1 + lens * growth, growth], -1)[..., None, :]
        by_lens /= outwards[..., None]
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
        self._rotations, self._slide = Rotations(self._axes * self._by), self._ways * self._by
        self.turns = self._rotations.matrices
        self.shifts = turned(self._rotations.jacobians, self._slide)

    def by_registers(self, places: Array) -> Array:
        """Derivatives of R x + s by registers (..., 3, 1), where R x is at `places` (..., 3)."""
        per_register = 1 + 2 * self._square * self._registers + 3 * self._cube * self._registers**2
        return (self._further(places) * per_register[..., None])[..., None]

    def by_numbers(self, places: Array) -> Array:
        """By the joints' numbers (..., 3, 9)."""
        by, registers = self._by[..., None], self._registers
        jacobians = self._rotations.jacobians
        by_axis = by * (self._rotations.jacobian_derivative(self._slide) - cross_matrix(places) @ jacobians)
        by_way, further = by * jacobians, self._further(places)
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
        seen = [self._gripper[motors - mount] for mount in chain.mounts]
        seen += [self._object[mount] for mount in chain.mounts]
        self._projection = Projection(self._cameras[..., None, [0, 1, 0, 1], :], np.stack(seen, -2))
        self.points = self._projection.points

    def by_registers(self) -> Array:
        """Derivatives of the points by registers (..., n, 4, 2, m)."""
        return self._by_joints(Twists.by_registers, self._chain.motors)[0]

    def by_numbers(self) -> Array:
        """By all numbers (..., n, 4, 2, p)."""
        chain = self._chain
        by_all, by_place = self._by_joints(Twists.by_numbers, chain.size)
        by_all[..., :2, :, chain.gripper] = by_place[..., :2, :, :]
        by_home = self._seen_from_home.derivatives()[..., None, :, :]
        by_all[..., 2:, :, chain.cameras] = by_place[..., 2:, :, :] @ by_home
        by_camera = self._projection.by_camera()
        for point in range(POINTS):
            by_all[..., point, :, chain.camera(point % len(CAMERAS))] += by_camera[..., point, :, :]
        return by_all

    def _by_joints(self, of_joints: Callable[[Twists, Array], Array], size: int) -> tuple[Array, Array]:
        """Derivatives of the points by joints, from each image back to where no joint has moved the point.

        Args:
            of_joints: Those of places by the joints that move them (joints, ..., n, 3, of each).
            size: k; the first of them are of the joints, one after the other.

        Returns:
            Derivatives (..., n, 4, 2, k), and those by where no joint has moved the points (..., n, 4, 2, 3).
        """
        turns, shifts, behind = self._twists.turns, self._twists.shifts, len(self._object) - 1
        by_place = self._projection.by_place()
        by_all = np.zeros((*self.points.shape, size))
        of_gripper = of_joints(self._twists, np.stack(self._gripper[:0:-1]) - shifts)
        if behind:
            moving = Twists(self._joints[:behind], self._registers[:behind])
            of_object = of_joints(moving, np.stack(self._object[:behind]) - shifts[:behind])
        each, motors = of_gripper.shape[-1], self._chain.motors
        columns = [slice(each * joint, each * (joint + 1)) for joint in range(motors)]
        for camera, mount in enumerate(self._chain.mounts):
            gripper, object_ = by_place[..., camera, :, :], by_place[..., len(CAMERAS) + camera, :, :]
            for joint in range(mount, motors):
                by_all[..., camera, :, columns[joint]] = gripper @ of_gripper[joint]
                gripper = gripper @ turns[joint]
            for joint in reversed(range(mount)):
                object_ = object_ @ turns[joint].swapaxes(-1, -2)
                by_all[..., len(CAMERAS) + camera, :, columns[joint]] = -object_ @ of_object[joint]
            by_place[..., camera, :, :], by_place[..., len(CAMERAS) + camera, :, :] = gripper, object_
        return by_all, by_place
