"""An arm as a chain of joints before two cameras: where its points are seen, and how that changes with it.

Every joint turns about an axis, slides along one, or both: a twist, as far as its register says (product of
exponentials, Brockett 1984). Nothing else is said of the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS

from ..base.observation import POINTS, Array

Values = NDArray[Any]
"""Real numbers, or complex ones with derivatives in their imaginary parts."""

JOINT = 9
"""Numbers of a joint: how far it turns about x, y, z and slides along them for a register of one (6), at
which register it stood when the others were told (1), and what the register's square and cube add (2)."""
GRIPPER = 3
"""Numbers of the gripper point: where it is at home."""
CAMERA = 8
"""Numbers of a camera: the logarithm of its focal length in image units, a lens coefficient, and the turn (3)
and shift (3) that take a point of the room to where it is before the camera."""
NEAREST = 0.05
"""Points are taken to be at least so far before a camera (a guard: they are divided by it)."""
UNDISTORTIONS = 8
"""Passes that undo a lens (a guard: each leaves a fifth of the error or less)."""
_STEP = 1e-30
"""Of derivatives by complex numbers (Squire & Trapp 1998): no rounding limits it from below."""


@dataclass(frozen=True)
class Chain:
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


class Views:
    """What a chain shows of gripper and object.

    Attributes:
        points: (n, 4, 2), in image units: gripper left, right, object left, right.

    Args:
        chain: Which numbers mean what.
        numbers: All of them (p,).
        registers: (n, m).
        homes: The object's sensor vectors as seen from home (n, 4): they tell where it is.
    """

    def __init__(self, chain: Chain, numbers: Array, registers: Array, homes: Array) -> None:
        self._chain, self._registers, self._homes = chain, registers, homes
        self._joints = numbers[: chain.gripper.start].reshape(chain.motors, 1, JOINT)
        self._cameras = numbers[chain.cameras].reshape(len(CAMERAS), CAMERA)
        self._turns, self._shifts = motion(self._joints, registers.T)
        count = len(registers)
        self._gripper = [np.tile(numbers[chain.gripper], (count, 1))]  # moved by ever more of the last joints
        for turn, shift in zip(self._turns[::-1], self._shifts[::-1], strict=True):
            self._gripper.append(_turned(turn, self._gripper[-1]) + shift)
        self._object = [triangulated(self._cameras, homes)]  # as a camera sees it that ever more joints move
        behind = max(chain.mounts)
        for turn, shift in zip(self._turns[:behind], self._shifts[:behind], strict=True):
            self._object.append(_turned(turn.swapaxes(1, 2), self._object[-1] - shift))
        self.points = np.empty((count, POINTS, 2))
        for camera, mount in enumerate(chain.mounts):
            self.points[:, camera] = projected(self._cameras[camera], self._gripper[chain.motors - mount])
            self.points[:, 2 + camera] = projected(self._cameras[camera], self._object[mount])

    def derivatives(self) -> Array:
        """Of the points (n, 4, 2, p + m) by all numbers, and by registers."""
        chain, (count, motors) = self._chain, self._registers.shape
        turns, shifts = self._joint_derivatives()
        columns = [np.r_[chain.joint(j), chain.size + j] for j in range(motors)]
        by_all = np.zeros((count, POINTS, 2, chain.size + motors))
        gripper = np.zeros((count, 3, by_all.shape[-1]))
        gripper[:, :, chain.gripper] = np.eye(GRIPPER)
        object_ = np.zeros_like(gripper)
        object_[:, :, chain.cameras] = _derivatives(
            lambda flat: triangulated(flat.reshape(-1, len(CAMERAS), 1, CAMERA).swapaxes(0, 1), self._homes),
            self._cameras.ravel(),
        )
        of_gripper, of_object = [gripper], [object_]
        for back, joint in enumerate(reversed(range(motors))):
            gripper = self._turns[joint] @ gripper
            moved = np.einsum("dnij,nj->nid", turns[:, joint], self._gripper[back])
            gripper[:, :, columns[joint]] += moved + shifts[:, joint].transpose(1, 2, 0)
            of_gripper.append(gripper)
        for joint in range(max(chain.mounts)):
            back_turn = self._turns[joint].swapaxes(1, 2)
            object_ = back_turn @ object_
            there = self._object[joint] - self._shifts[joint]
            moved = np.einsum("dnji,nj->nid", turns[:, joint], there)
            object_[:, :, columns[joint]] += moved - back_turn @ shifts[:, joint].transpose(1, 2, 0)
            of_object.append(object_)
        for camera, mount in enumerate(chain.mounts):
            seen = ((self._gripper, of_gripper, motors - mount), (self._object, of_object, mount))
            for point, (places, of_places, at) in zip((camera, 2 + camera), seen, strict=True):
                by_camera, by_place = self._projection_derivatives(camera, places[at])
                by_all[:, point] = by_place @ of_places[at]
                by_all[:, point, :, chain.camera(camera)] += by_camera
        return by_all

    def _joint_derivatives(self) -> tuple[Array, Array]:
        """Of turns (JOINT + 1, m, n, 3, 3) and shifts (JOINT + 1, m, n, 3), by numbers and registers."""
        directions = _STEP * 1j * np.eye(JOINT + 1)[:, None, None]
        turns, shifts = motion(
            self._joints + directions[..., :JOINT], self._registers.T + directions[..., JOINT]
        )
        return turns.imag / _STEP, shifts.imag / _STEP

    def _projection_derivatives(self, camera: int, places: Array) -> tuple[Array, Array]:
        """Of image points by the camera's numbers (n, 2, CAMERA) and by places (n, 2, 3)."""
        directions = _STEP * 1j * np.eye(CAMERA + 3)[:, None]
        points = projected(
            self._cameras[camera] + directions[..., :CAMERA], places + directions[..., CAMERA:]
        )
        by_all = points.imag.transpose(1, 2, 0) / _STEP
        return by_all[..., :CAMERA], by_all[..., CAMERA:]


def motion(joint: Values, registers: Values) -> tuple[Values, Values]:
    """Turn (..., 3, 3) and shift (..., 3) of what a joint of numbers (..., 9) moves, at registers (...)."""
    by = joint[..., 6] + registers + joint[..., 7] * registers**2 + joint[..., 8] * registers**3
    turn, slide = joint[..., :3] * by[..., None], joint[..., 3:6] * by[..., None]
    cross, (first, second, third) = _cross(turn), _factors(turn)
    squared = cross @ cross
    way = np.eye(3) + second * cross + third * squared
    return np.eye(3) + first * cross + second * squared, _turned(way, slide)


def rotation(turn: Values) -> Values:
    """Rotation matrices (..., 3, 3) of turns (..., 3): an axis times the angle about it."""
    cross, (first, second, _) = _cross(turn), _factors(turn)
    return np.eye(3) + first * cross + second * (cross @ cross)


def projected(camera: Values, places: Values) -> Values:
    """Image points (..., 2) of places (..., 3) in the room, by a camera's numbers (..., 8)."""
    before = _turned(rotation(camera[..., 2:5]), places) + camera[..., 5:8]
    depths = before[..., 2:]
    flat = before[..., :2] / np.where(depths.real > NEAREST, depths, NEAREST)
    squares = (flat * flat).sum(-1, keepdims=True)
    return np.exp(camera[..., :1]) * flat * (1 + camera[..., 1:2] * squares)


def triangulated(cameras: Values, sensors: Array) -> Values:
    """Places (..., 3) in the room, seen at sensors (n, 4): midway between both rays.

    Args:
        cameras: Of both cameras (2, ..., 8).
        sensors: In image units.
    """
    starts, ways = [], []
    for camera, seen in zip(cameras, sensors.reshape(-1, 2, 2).swapaxes(0, 1), strict=True):
        distorted = flat = seen * np.exp(-camera[..., :1])
        for _ in range(UNDISTORTIONS):
            flat = distorted / (1 + camera[..., 1:2] * (flat * flat).sum(-1, keepdims=True))
        back = rotation(camera[..., 2:5]).swapaxes(-1, -2)
        starts.append(-_turned(back, camera[..., 5:8]))
        ways.append(_turned(back, np.concatenate([flat, np.ones_like(flat[..., :1])], -1)))
    (left, right), apart = ways, starts[1] - starts[0]
    ll, rr, lr = ((a * b).sum(-1) for a, b in ((left, left), (right, right), (left, right)))
    la, ra = (left * apart).sum(-1), (right * apart).sum(-1)
    sine = ll * rr - lr * lr
    far_left, far_right = (rr * la - lr * ra) / sine, (lr * la - ll * ra) / sine
    middle = starts[0] + far_left[..., None] * left + starts[1] + far_right[..., None] * right
    return middle / 2


def _derivatives(function: Callable[[Values], Values], numbers: Array) -> Array:
    """Of a function's values (n, k) by numbers (c,): (n, k, c)."""
    values = function(numbers + _STEP * 1j * np.eye(len(numbers)))
    return np.asarray(values.imag.transpose(1, 2, 0) / _STEP)


def _turned(turns: Values, places: Values) -> Values:
    return np.asarray(turns @ places[..., None])[..., 0]


def _cross(vector: Values) -> Values:
    """The matrices (..., 3, 3) that make cross products with vectors (..., 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    cross = np.zeros((*vector.shape, 3), vector.dtype)
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -z, y, -x
    return cross - cross.swapaxes(-1, -2)


def _factors(turn: Values) -> tuple[Values, Values, Values]:
    """Sin a / a, (1 - cos a) / a², (a - sin a) / a³ (..., 1, 1) of turns (..., 3) by angles a."""
    squares = (turn * turn).sum(-1)[..., None, None]
    small = squares.real < 1e-4
    angles = np.sqrt(np.where(small, 1.0, squares))
    return (
        np.where(small, 1 - squares / 6 + squares**2 / 120, np.sin(angles) / angles),
        np.where(small, 0.5 - squares / 24 + squares**2 / 720, (1 - np.cos(angles)) / angles**2),
        np.where(small, 1 / 6 - squares / 120 + squares**2 / 5040, (angles - np.sin(angles)) / angles**3),
    )
