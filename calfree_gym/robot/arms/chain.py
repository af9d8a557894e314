"""Kinematics of a chain of bodies, for any arm: where its last body is at given joint positions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from calfree_gym.geometry import Array, quaternion_about, rotation_matrix

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_OWN = np.eye(4)


class Chain:
    """The way from the world to one body, as MuJoCo computes it; links stretch, all other joints stay.

    It is a product of transforms: each motor turns about the z-axis of a frame of its own, or slides along
    it, and what lies between two such frames is fixed, but for links, whose offsets stretch.

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
        between: list[Array] = []
        self._motors: list[int] = []
        self._slides: list[bool] = []
        self._links: list[list[tuple[int, Array]]] = [[]]
        references: list[float] = []
        fixed = np.eye(4)
        for each in path_to(model, body):
            first = int(model.body_jntadr[each])
            joints = range(first, first + int(model.body_jntnum[each]))
            if free := [joint for joint in joints if model.jnt_type[joint] == FREE]:
                at = int(model.jnt_qposadr[free[0]])
                fixed = fixed @ transform(rotation_matrix(qpos[at + 3 : at + 7]), qpos[at : at + 3])
                continue
            if each in links:
                self._links[-1].append((list(links).index(each), fixed[:3, :3] @ model.body_pos[each]))
            else:
                fixed = fixed @ transform(np.eye(3), model.body_pos[each])
            fixed = fixed @ transform(rotation_matrix(model.body_quat[each]))
            for joint in joints:
                if joint not in motors:
                    fixed = fixed @ _still(model, joint, qpos)
                    continue
                there, back = _about(model, joint)
                between.append(fixed @ there)
                fixed = back
                self._links.append([])
                self._motors.append(list(motors).index(joint))
                self._slides.append(bool(model.jnt_type[joint] == SLIDE))
                references.append(float(model.qpos0[model.jnt_qposadr[joint]]))
        self._references = np.array(references)[:, None]
        self._between = np.array([*between, fixed])[:, :3, :, None, None].swapaxes(1, 2)  # step, column, row

    def frames(self, joints: Array, stretch: Array, frame: Array = _OWN) -> tuple[Array, Array]:
        """Origin (..., 3) in m of a frame that moves with the last body, and its axes as columns (..., 3, 3).

        Args:
            joints: Of the motors (..., m), in rad, or in m where they slide.
            stretch: Of the links (..., l), relative to the model's.
            frame: In that of the body (4, 4), a homogeneous transform; else its own.
        """
        there = self._carried(frame, joints, stretch)
        return there[..., 3], there[..., :3]

    def carried(self, point: Array, joints: Array, stretch: Array) -> Array:
        """Where a point (3,) of the last body is in the room (..., 3), in m.

        Args:
            point: In the frame of the body.
            joints: Of the motors (..., m).
            stretch: Of the links (..., l).
        """
        return self._carried(np.append(point, 1.0)[:, None], joints, stretch)[..., 0]

    def _carried(self, columns: Array, joints: Array, stretch: Array) -> Array:
        """Where columns (4, c), points or directions of the last body, are in the room (..., 3, c)."""
        shape = np.broadcast_shapes(joints.shape[:-1], stretch.shape[:-1])
        moved = _by_row(joints[..., self._motors], shape) - self._references
        stretched, own = _by_row(stretch, shape), columns[3, :, None]
        sine, cosine = np.sin(moved), np.cos(moved)
        at: Sequence[Array] | Array = columns[:3, :, None]
        for step in reversed(range(len(self._between))):
            x, y, z, origin = self._between[step]
            for link, offset in self._links[step]:
                origin = origin + offset[:, None, None] * stretched[link]
            at = x * at[0] + y * at[1] + z * at[2] + origin * own
            if step and self._slides[step - 1]:
                at = at[0], at[1], at[2] + moved[step - 1] * own
            elif step:
                s, c = sine[step - 1], cosine[step - 1]
                at = c * at[0] - s * at[1], s * at[0] + c * at[1], at[2]
        every = np.broadcast_to(at, (3, columns.shape[1], moved.shape[1]))
        return np.moveaxis(every.reshape(*every.shape[:2], *shape), (0, 1), (-2, -1))


def path_to(model: mujoco.MjModel, body: int) -> list[int]:
    """Ids of the bodies from a child of the world to `body`."""
    path: list[int] = []
    while body:
        path.insert(0, body)
        body = int(model.body_parentid[body])
    return path


def _by_row(values: Array, shape: tuple[int, ...]) -> Array:
    """Values (..., k) of rows of this shape, one contiguous row of them for each k (k, n)."""
    every = np.broadcast_to(values, (*shape, values.shape[-1]))
    return np.ascontiguousarray(every.reshape(math.prod(shape), -1 if every.size else 0).T)


def _about(model: mujoco.MjModel, joint: int) -> tuple[Array, Array]:
    """Transforms (4, 4) to a frame whose z-axis is that of a joint, through its anchor, and back."""
    turn = np.empty(4)
    mujoco.mju_quatZ2Vec(turn, model.jnt_axis[joint])
    axes, anchor = rotation_matrix(turn), model.jnt_pos[joint]
    return transform(axes, anchor), transform(axes.T, -axes.T @ anchor)


def _still(model: mujoco.MjModel, joint: int, qpos: Array) -> Array:
    """The transform (4, 4) of a joint that is no motor's, and stays where it is in qpos (nq,)."""
    at, axis = int(model.jnt_qposadr[joint]), model.jnt_axis[joint]
    moved = qpos[at] - model.qpos0[at]
    if model.jnt_type[joint] == SLIDE:
        return transform(np.eye(3), moved * axis)
    turn = qpos[at : at + 4] if model.jnt_type[joint] == BALL else quaternion_about(axis, moved)
    there, back = (transform(np.eye(3), sign * model.jnt_pos[joint]) for sign in (1, -1))
    return np.asarray(there @ transform(rotation_matrix(turn)) @ back)


def transform(rotation: Array, offset: Array | float = 0.0) -> Array:
    """A homogeneous transform (4, 4)."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, offset
    return transform
