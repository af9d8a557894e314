"""Kinematics of a chain of bodies, for any arm: where its last body is at given joint positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from calfree_gym.geometry import Array, rotation_matrix

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


class Chain:
    """The way from the world to one body, as MuJoCo computes it; links stretch, all other joints stay.

    Args:
        model: The compiled model.
        body: Id of the last body.
        motors: Ids of the joints that move, m of them.
        links: Ids of the bodies whose distance from the body before can be stretched, l of them.
        qpos: Where all other joints stay (nq,).
    """

    def __init__(
        self, model: mujoco.MjModel, body: int, motors: Sequence[int], links: Sequence[int], qpos: Array
    ) -> None:
        self._steps: list[_Step] = []
        for each in path_to(model, body):
            joints = range(model.body_jntadr[each], model.body_jntadr[each] + model.body_jntnum[each])
            if free := [joint for joint in joints if model.jnt_type[joint] == FREE]:
                at = int(model.jnt_qposadr[free[0]])
                self._steps.append(_Fixed(qpos[at : at + 3], rotation_matrix(qpos[at + 3 : at + 7])))
                continue
            link = list(links).index(each) if each in links else None
            self._steps.append(_Offset(model.body_pos[each].copy(), link))
            self._steps.append(_Fixed(np.zeros(3), rotation_matrix(model.body_quat[each])))
            self._steps += [_joint(model, joint, list(motors), qpos) for joint in joints]

    def frames(self, joints: Array, stretch: Array) -> tuple[Array, Array]:
        """Position (..., 3) in m of the last body in the room, and its axes as columns (..., 3, 3).

        Args:
            joints: Of the motors (..., m), in rad, or in m where they slide.
            stretch: Of the links (..., l), relative to the model's.
        """
        shape = np.broadcast_shapes(joints.shape[:-1], stretch.shape[:-1])
        position, axes = np.zeros((*shape, 3)), np.broadcast_to(np.eye(3), (*shape, 3, 3))
        for step in self._steps:
            position, axes = step(position, axes, joints, stretch)
        return position, axes


def path_to(model: mujoco.MjModel, body: int) -> list[int]:
    """Ids of the bodies from a child of the world to `body`."""
    path: list[int] = []
    while body:
        path.insert(0, body)
        body = int(model.body_parentid[body])
    return path


class _Step(Protocol):
    """A part of the way: from a frame (..., 3), (..., 3, 3) to the next."""

    def __call__(
        self, position: Array, axes: Array, joints: Array, stretch: Array
    ) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class _Offset:
    offset: Array
    link: int | None

    def __call__(self, position: Array, axes: Array, joints: Array, stretch: Array) -> tuple[Array, Array]:
        way = axes @ self.offset
        return position + (way if self.link is None else stretch[..., self.link, None] * way), axes


@dataclass(frozen=True)
class _Fixed:
    offset: Array
    rotation: Array

    def __call__(self, position: Array, axes: Array, joints: Array, stretch: Array) -> tuple[Array, Array]:
        return position + axes @ self.offset, axes @ self.rotation


@dataclass(frozen=True)
class _Slide:
    motor: int
    axis: Array
    reference: float

    def __call__(self, position: Array, axes: Array, joints: Array, stretch: Array) -> tuple[Array, Array]:
        return position + (joints[..., self.motor, None] - self.reference) * (axes @ self.axis), axes


@dataclass(frozen=True)
class _Hinge:
    motor: int
    axis: Array
    anchor: Array
    reference: float

    def __call__(self, position: Array, axes: Array, joints: Array, stretch: Array) -> tuple[Array, Array]:
        turned = axes @ _rotations(self.axis, joints[..., self.motor] - self.reference)
        return position + axes @ self.anchor - turned @ self.anchor, turned


def _joint(model: mujoco.MjModel, joint: int, motors: list[int], qpos: Array) -> _Step:
    at, kind = int(model.jnt_qposadr[joint]), int(model.jnt_type[joint])
    axis, anchor = model.jnt_axis[joint].copy(), model.jnt_pos[joint].copy()
    if joint in motors:
        motor, reference = motors.index(joint), float(model.qpos0[at])
        return _Slide(motor, axis, reference) if kind == SLIDE else _Hinge(motor, axis, anchor, reference)
    if kind == SLIDE:
        return _Fixed(axis * (qpos[at] - model.qpos0[at]), np.eye(3))
    if kind == BALL:
        rotation = rotation_matrix(qpos[at : at + 4])
    else:
        rotation = _rotations(axis, qpos[at] - model.qpos0[at])
    return _Fixed(anchor - rotation @ anchor, rotation)


def _rotations(axis: Array, angles: Array) -> Array:
    """Rotation matrices (..., 3, 3) about a unit axis (3,) by angles (...) in rad (Rodrigues 1840)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angles = np.asarray(angles)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * (cross @ cross))
