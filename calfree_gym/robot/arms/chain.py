"""Kinematics of a chain of bodies, for any arm: where its last body is at given joint positions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from calfree_gym.geometry import Array, rotation_matrix

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


class Chain:
    """The way from the world to one body, as MuJoCo computes it; links stretch, all other joints stay.

    It is a product of homogeneous transforms, of which the upper three rows are kept: one for each motor and
    what lies before it. Each is a sum: `still`, and what grows with sine and cosine of the motor's position;
    the position itself, where it slides, and the stretch of links add to its last column.

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
        steps: list[tuple[Array, Array, Array]] = []
        self._motors: list[int] = []
        self._slides: list[tuple[int, Array]] = []
        self._links: list[tuple[int, int, Array]] = []
        references: list[float] = []
        fixed = np.eye(4)
        for each in path_to(model, body):
            first = int(model.body_jntadr[each])
            joints = range(first, first + int(model.body_jntnum[each]))
            if free := [joint for joint in joints if model.jnt_type[joint] == FREE]:
                at = int(model.jnt_qposadr[free[0]])
                fixed = fixed @ _transform(rotation_matrix(qpos[at + 3 : at + 7]), qpos[at : at + 3])
                continue
            if each in links:
                self._links.append(
                    (len(steps), list(links).index(each), fixed[:3, :3] @ model.body_pos[each])
                )
            else:
                fixed = fixed @ _transform(np.eye(3), model.body_pos[each])
            fixed = fixed @ _transform(rotation_matrix(model.body_quat[each]))
            for joint in joints:
                if joint not in motors:
                    fixed = fixed @ _still(model, joint, qpos)
                    continue
                if model.jnt_type[joint] == SLIDE:
                    self._slides.append((len(steps), fixed[:3, :3] @ model.jnt_axis[joint]))
                    steps.append((fixed, _NOTHING, _NOTHING))
                else:
                    still, sine, cosine = _hinge(model, joint)
                    steps.append((fixed @ still, fixed @ sine, fixed @ cosine))
                self._motors.append(list(motors).index(joint))
                references.append(float(model.qpos0[model.jnt_qposadr[joint]]))
                fixed = np.eye(4)
        steps.append((fixed, _NOTHING, _NOTHING))
        self._references = np.array(references)[:, None]
        parts = np.array(steps)[:, :, :3].transpose(1, 0, 3, 2)[..., None]  # what, step, column, row
        self._still, self._sine, self._cosine = parts[0], parts[1, :-1], parts[2, :-1]

    def frames(self, joints: Array, stretch: Array) -> tuple[Array, Array]:
        """Position (..., 3) in m of the last body in the room, and its axes as columns (..., 3, 3).

        Args:
            joints: Of the motors (..., m), in rad, or in m where they slide.
            stretch: Of the links (..., l), relative to the model's.
        """
        frame = self._carried(np.eye(4), joints, stretch)
        return frame[..., 3], frame[..., :3]

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
        stretched = _by_row(stretch, shape)
        ways = np.repeat(self._still, moved.shape[-1], -1)
        ways[:-1] += self._sine * np.sin(moved)[:, None, None]
        ways[:-1] += self._cosine * np.cos(moved)[:, None, None]
        for step, axis in self._slides:
            ways[step, 3] += axis[:, None] * moved[step]
        for step, link, offset in self._links:
            ways[step, 3] += offset[:, None] * stretched[link]
        at, own = columns[:3, :, None], columns[3, :, None]
        for x, y, z, origin in ways[::-1, :, :, None]:
            at = x * at[0] + y * at[1] + z * at[2] + origin * own
        return np.ascontiguousarray(np.moveaxis(at, -1, 0)).reshape(*shape, 3, -1)


def path_to(model: mujoco.MjModel, body: int) -> list[int]:
    """Ids of the bodies from a child of the world to `body`."""
    path: list[int] = []
    while body:
        path.insert(0, body)
        body = int(model.body_parentid[body])
    return path


_NOTHING = np.zeros((4, 4))


def _by_row(values: Array, shape: tuple[int, ...]) -> Array:
    """Values (..., k) of rows of this shape, one contiguous row of them for each k (k, n)."""
    every = np.broadcast_to(values, (*shape, values.shape[-1]))
    return np.ascontiguousarray(every.reshape(math.prod(shape), -1 if every.size else 0).T)


def _hinge(model: mujoco.MjModel, joint: int) -> tuple[Array, Array, Array]:
    """A hinge turns about its axis through its anchor (Rodrigues 1840).

    Returns:
        Three parts (4, 4): its transform is the first, the second times the angle's sine, and the third times
        its cosine.
    """
    x, y, z = axis = model.jnt_axis[joint]
    cross, along = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.outer(axis, axis)
    there, back = (_transform(np.eye(3), sign * model.jnt_pos[joint]) for sign in (1, -1))
    sine, cosine = (there @ _transform(part, corner=0) @ back for part in (cross, np.eye(3) - along))
    return there @ _transform(along) @ back, sine, cosine


def _still(model: mujoco.MjModel, joint: int, qpos: Array) -> Array:
    """The transform (4, 4) of a joint that is no motor's, and stays where it is in qpos (nq,)."""
    at = int(model.jnt_qposadr[joint])
    if model.jnt_type[joint] == BALL:
        there, back = (_transform(np.eye(3), sign * model.jnt_pos[joint]) for sign in (1, -1))
        return np.asarray(there @ _transform(rotation_matrix(qpos[at : at + 4])) @ back)
    moved = qpos[at] - model.qpos0[at]
    if model.jnt_type[joint] == SLIDE:
        return _transform(np.eye(3), moved * model.jnt_axis[joint])
    still, sine, cosine = _hinge(model, joint)
    return np.asarray(still + np.sin(moved) * sine + np.cos(moved) * cosine)


def _transform(rotation: Array, offset: Array | float = 0.0, corner: float = 1.0) -> Array:
    """A homogeneous transform (4, 4); with another `corner` than 1, a part of such a one in a sum."""
    transform = np.zeros((4, 4))
    transform[:3, :3], transform[:3, 3], transform[3, 3] = rotation, offset, corner
    return transform
