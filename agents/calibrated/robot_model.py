"""What a calibrated robot knows of itself in numbers: cameras, arm and motors (paper, section 2.2).

It is the model that the paper does without, and as true as a model can be: its kinematics, the curve of its
motors, its lens and its joint limits are those of the simulator itself, imported from it. Only numbers can
be wrong, never the kind of model. Directions and signs are those of `calfree_gym.world`: a camera looks along
its -z axis, y up.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from calfree_gym.errors import check_choice
from calfree_gym.geometry import rotation_matrix
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.robot.arms.movemaster import HOME, JOINT_LIMITS, SPAN, gripper_position
from calfree_gym.robot.motors import curve_inverse
from calfree_gym.vision.cameras import MOUNTS, image_points, pinhole
from calfree_gym.world import World

from ..base.observation import POINTS, Array


def rotation(angles: Array) -> Array:
    """Rotation matrices (..., 3, 3) of angles (..., 3) in rad: the product of those about x, y and z."""
    c, s = np.cos(angles), np.sin(angles)
    cx, cy, cz, sx, sy, sz = (each[..., i] for each in (c, s) for i in range(3))
    rows = [
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    ]
    return _matrix(rows)


def rotation_axes(angles: Array) -> Array:
    """Axes (..., 3, 3) about which each of the angles (..., 3) turns, as columns, in the turned frame."""
    c, s = np.cos(angles), np.sin(angles)
    cy, cz, sy, sz = (each[..., i] for each in (c, s) for i in (1, 2))
    return _matrix([[cy * cz, sz, 0.0], [-cy * sz, cz, 0.0], [sy, 0.0, 1.0]])


def _matrix(rows: Sequence[Sequence[Array | float]]) -> Array:
    """Matrices (..., 3, 3) from their entries (...), of which the first is an array."""
    matrix = np.empty((*np.shape(rows[0][0]), 3, 3))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            matrix[..., i, j] = entry
    return matrix


_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
"""From camera axes with y up, looking along -z, to OpenCV's: y down, looking along z."""
_UNDISTORTING = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-12)
"""When OpenCV ends the inversion of the lens (a guard: far below a pixel)."""


@dataclass(frozen=True)
class RobotModel:
    """Cameras, arm and motors of one robot, or of several at once along leading axes (...).

    Attributes:
        camera_position: Optical centres (..., 2, 3) in m, in the frame of their mount.
        camera_axes: Camera axes as columns (..., 2, 3, 3).
        focal_length: In image units (..., 2).
        lens_k1: Radial distortion (..., 2).
        link_lengths: In m (..., 5), in the order of `calfree_gym.robot.arms.movemaster.LINKS`.
        joint_zeros: Of J1-J4 in rad (..., 4).
        motor_gain: Relative to the built robot's, with its sign (..., 3).
        motor_curvature: Of the map from register to angle (..., 3).
        cameras_on_waist: Whether the cameras turn with the waist.
    """

    camera_position: Array
    camera_axes: Array
    focal_length: Array
    lens_k1: Array
    link_lengths: Array
    joint_zeros: Array
    motor_gain: Array
    motor_curvature: Array
    cameras_on_waist: bool

    @classmethod
    def of(cls, world: World, camera_mount: str) -> RobotModel:
        """A model that is true in `world`.

        Args:
            world: All that a calibration would find out. `calfree_gym.world.nominal()` is the robot as built.
            camera_mount: What the cameras are fixed to: "waist" or "stand".

        Raises:
            ValueError: `camera_mount` is neither.
        """
        check_choice("camera_mount", camera_mount, MOUNTS)
        return cls(
            camera_position=world.camera_position,
            camera_axes=np.stack([rotation_matrix(q) for q in world.camera_orientation]),
            focal_length=world.focal_length * IMAGE_UNIT,
            lens_k1=world.lens_k1,
            link_lengths=world.link_lengths,
            joint_zeros=world.joint_zeros,
            motor_gain=world.motor_sign * world.motor_gain,
            motor_curvature=world.motor_curvature,
            cameras_on_waist=camera_mount == "waist",
        )

    def joints(self, registers: Array) -> Array:
        """Angles (..., n, 4) of J1-J4 in rad at `registers` (n, 3); J4 holds the hand vertical.

        It does so by the joint angles that the arm measures, so that errors of the joint zeros tilt the hand.
        """
        bent = registers + self.motor_curvature[..., None, :] * registers * (registers * registers - 1)
        first = self._rest + self._scale * bent
        wrist = self._vertical[..., None] - first[..., 1] - first[..., 2]
        wrist = np.minimum(np.maximum(wrist, JOINT_LIMITS[3, 0]), JOINT_LIMITS[3, 1])
        return np.concatenate([first, wrist[..., None]], -1)

    def gripper(self, joints: Array) -> Array:
        """Gripper points (..., n, 3) in the room, in m, at `joints` (..., n, 4)."""
        return gripper_position(joints, self.link_lengths[..., None, :])

    def image(self, points: Array, joints: Array) -> Array:
        """Sensor vectors (..., n, 4) of `points` (..., n, 3) in the room, seen with the arm at `joints`."""
        flat, _ = pinhole(
            self.in_mount_frame(points, joints)[..., None, :],
            self.camera_position[..., None, :, :],
            self.camera_axes[..., None, :, :, :],
        )
        focal, k1 = self.focal_length[..., None, :, None], self.lens_k1[..., None, :]
        seen, _ = image_points(flat, focal, np.zeros(2), k1, 0.0, np.inf)
        return seen.reshape(*seen.shape[:-2], 4)

    def points(self, registers: Array, objects: Array) -> Array:
        """Image points (..., n, 4, 2) at `registers` (n, 3), with objects at (..., n, 3) in m."""
        joints = self.joints(registers)
        both = np.concatenate([self.gripper(joints), objects], -2)
        seen = self.image(both, np.concatenate([joints, joints], -2))
        gripper, object_ = seen[..., : len(registers), :], seen[..., len(registers) :, :]
        points = np.concatenate([gripper, object_], -1)
        return points.reshape(*points.shape[:-1], POINTS, 2)

    def in_mount_frame(self, points: Array, joints: Array) -> Array:
        """Points (..., n, 3) in the room, in the frame of the cameras' mount, with the arm at `joints`."""
        return self._turned(points, -joints[..., 0]) if self.cameras_on_waist else points

    def triangulate(self, sensors: Array, joints: Array) -> Array:
        """Where one robot sees points: stereo evaluation (paper, section 2.2).

        Args:
            sensors: Sensor vectors (n, 4) of marked points.
            joints: Angles (n, 4) of the arm when each was seen.

        Returns:
            Points (n, 3) in the room, in m.
        """
        if not len(sensors):  # of no points OpenCV makes None
            return np.empty((0, 3))
        left, right = (
            cv2.undistortPoints(sensors[:, None, 2 * i : 2 * i + 2], *lens, criteria=_UNDISTORTING)[:, 0].T
            for i, lens in enumerate(self._lenses)
        )
        first, second = self._projections
        found = cv2.triangulatePoints(first, second, left, right)
        points = (found[:3] / found[3]).T
        return self._turned(points, joints[:, 0]) if self.cameras_on_waist else points

    def registers(self, point: Array) -> Array:
        """Registers (3,) that bring the gripper of one robot to `point` (3,) in m, or as near as they can.

        Inverse kinematics in closed form (paper, section 2.2), with the elbow up and the hand as vertical as
        the wrist can hold it: at its limit, forearm and hand are one link. Complex numbers are the plane of
        the arm: real parts ahead, imaginary parts up.
        """
        base, shoulder, upper_arm, forearm, hand = self.link_lengths
        target = complex(np.hypot(point[0], point[1]) - shoulder, point[2] - base)
        lifted, bent = _two_links(target - cmath.rect(hand, self._vertical), upper_arm, forearm)
        wrist = self._vertical - lifted - bent
        if not JOINT_LIMITS[3, 0] <= wrist <= JOINT_LIMITS[3, 1]:
            limit = min(max(wrist, JOINT_LIMITS[3, 0]), JOINT_LIMITS[3, 1])
            length, ahead = cmath.polar(forearm + cmath.rect(hand, limit))
            lifted, bent = _two_links(target, upper_arm, length)
            bent -= ahead
        angles = (np.arctan2(point[1], point[0]), lifted, bent)
        return curve_inverse((angles - self._rest[0]) / self._scale[0], self.motor_curvature)

    @staticmethod
    def _turned(points: Array, waist: Array) -> Array:
        """Points (..., n, 3) turned about the waist's axis by `waist` (..., n) in rad."""
        c, s = np.cos(waist), np.sin(waist)
        x, y = points[..., 0], points[..., 1]
        turned = np.empty((*np.broadcast_shapes(c.shape, x.shape), 3))
        turned[..., 0], turned[..., 1], turned[..., 2] = c * x - s * y, s * x + c * y, points[..., 2]
        return turned

    @cached_property
    def _rest(self) -> Array:
        return HOME + self.joint_zeros[..., None, :3]

    @cached_property
    def _scale(self) -> Array:
        return self.motor_gain[..., None, :] * SPAN

    @cached_property
    def _vertical(self) -> Array:
        """Sum of the angles of J2-J4 (...) with the hand held vertical, as measured by the arm."""
        return -np.pi / 2 + self.joint_zeros[..., 1:].sum(-1)

    @cached_property
    def _lenses(self) -> list[tuple[Array, Array]]:
        return [
            (np.diag([focal, focal, 1.0]), np.array([k1, 0.0, 0.0, 0.0]))
            for focal, k1 in zip(self.focal_length, self.lens_k1, strict=True)
        ]

    @cached_property
    def _projections(self) -> list[Array]:
        turns = [_TO_OPENCV @ axes.T for axes in self.camera_axes]
        return [np.column_stack([r, -r @ c]) for r, c in zip(turns, self.camera_position, strict=True)]


def _two_links(target: complex, first: float, second: float) -> tuple[float, float]:
    """Angle of the first of two links and bend between them, elbow up, that reach to `target`."""
    bend = (abs(target) ** 2 - first**2 - second**2) / (2 * first * second)
    elbow = -math.acos(min(max(bend, -1.0), 1.0))
    return cmath.phase(target) - cmath.phase(first + cmath.rect(second, elbow)), elbow
