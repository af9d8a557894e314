"""Kinematics of a chain of bodies, for any arm: where its last body is at given joint positions."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import mujoco
import numpy as np

from calfree_gym.geometry import Array, rotation_matrix

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_Point = tuple[Array | float, ...]
"""Its coordinates: x, y and z, each (...)."""
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


class Chain:
    """The way from the world to one body, as MuJoCo computes it; links stretch, all other joints stay.

    It is a product of homogeneous transforms (4, 4): one for each motor and what lies before it.

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
        fixed, stretched = np.eye(4), {}
        for each in path_to(model, body):
            first = int(model.body_jntadr[each])
            joints = range(first, first + int(model.body_jntnum[each]))
            if free := [joint for joint in joints if model.jnt_type[joint] == FREE]:
                at = int(model.jnt_qposadr[free[0]])
                fixed = fixed @ _transform(rotation_matrix(qpos[at + 3 : at + 7]), qpos[at : at + 3])
                continue
            if each in links:
                stretched[list(links).index(each)] = fixed @ _transform(
                    np.zeros((3, 3)), model.body_pos[each], 0
                )
            else:
                fixed = fixed @ _transform(np.eye(3), model.body_pos[each])
            fixed = fixed @ _transform(rotation_matrix(model.body_quat[each]))
            for joint in joints:
                if joint in motors:
                    self._steps.append(
                        _Step(list(motors).index(joint), _joint(model, joint).after(fixed), stretched)
                    )
                    fixed, stretched = np.eye(4), {}
                else:
                    fixed = fixed @ _still(model, joint, qpos)
        if stretched or not self._steps or (fixed != np.eye(4)).any():
            self._steps.append(_Step(0, _Joint(0.0, fixed), stretched))

    def frames(self, joints: Array, stretch: Array) -> tuple[Array, Array]:
        """Position (..., 3) in m of the last body in the room, and its axes as columns (..., 3, 3).

        Args:
            joints: Of the motors (..., m), in rad, or in m where they slide.
            stretch: Of the links (..., l), relative to the model's.
        """
        shape = np.broadcast_shapes(joints.shape[:-1], stretch.shape[:-1])
        frame = self._steps[0](joints, stretch)
        for step in self._steps[1:]:
            frame = frame @ step(joints, stretch)
        frame = np.broadcast_to(frame, (*shape, 4, 4))
        return frame[..., :3, 3], frame[..., :3, :3]

    def carried(self, point: Array, joints: Array, stretch: Array) -> Array:
        """Where a point (3,) of the last body is in the room (..., 3), in m.

        Args:
            point: In the frame of the body.
            joints: Of the motors (..., m).
            stretch: Of the links (..., l).
        """
        at: _Point = tuple(point.tolist())
        for step in reversed(self._steps):
            at = step.carry(at, joints, stretch)
        return np.stack(np.broadcast_arrays(*at), -1)


def path_to(model: mujoco.MjModel, body: int) -> list[int]:
    """Ids of the bodies from a child of the world to `body`."""
    path: list[int] = []
    while body:
        path.insert(0, body)
        body = int(model.body_parentid[body])
    return path


@dataclass(frozen=True)
class _Joint:
    """Where a joint takes what it carries: a transform that is a sum, of which terms depend on its position.

    Attributes:
        reference: Its position in which the model is written.
        fixed: The part that does not depend on it (4, 4).
        terms: Functions of its position, and what they multiply (4, 4).
    """

    reference: float
    fixed: Array
    terms: tuple[tuple[Callable[..., Any], Array], ...] = ()

    def __call__(self, positions: Array) -> Array:
        """The transforms (..., 4, 4) at positions (...)."""
        moved = np.asarray(positions - self.reference)[..., None, None]
        return np.asarray(sum((function(moved) * by for function, by in self.terms), self.fixed))

    def carry(self, at: _Point, positions: Array) -> list[_Point]:
        """The terms of the sum that is where it takes a point."""
        moved = positions - self.reference
        changing = (_scaled(function(moved), _applied(by, at)) for function, by in self.terms)
        return [_applied(self.fixed, at), *changing]

    def after(self, transform: Array) -> _Joint:
        """The same behind a fixed transform (4, 4)."""
        terms = tuple((function, transform @ by) for function, by in self.terms)
        return _Joint(self.reference, transform @ self.fixed, terms)


class _Step(NamedTuple):
    """A part of the way: a motor's joint, and what links on the way to it add where they stretch (4, 4)."""

    motor: int
    joint: _Joint
    links: dict[int, Array]

    def __call__(self, joints: Array, stretch: Array) -> Array:
        """The transforms (..., 4, 4)."""
        ways = (stretch[..., link, None, None] * by for link, by in self.links.items())
        return np.asarray(sum(ways, self.joint(joints[..., self.motor])))

    def carry(self, at: _Point, joints: Array, stretch: Array) -> _Point:
        """Where a point goes."""
        terms = self.joint.carry(at, joints[..., self.motor])
        terms += [_scaled(stretch[..., link], _applied(by, at)) for link, by in self.links.items()]
        return tuple(map(_sum, zip(*terms, strict=True)))


def _applied(transform: Array, at: _Point) -> _Point:
    """A transform (4, 4) of a point; what is multiplied by 0 is not computed."""
    return tuple(
        _sum(entry * each for entry, each in zip(row, (*at, 1.0), strict=True) if entry)
        for row in transform[:3].tolist()
    )


def _scaled(by: Array, at: _Point) -> _Point:
    return tuple(0.0 if _is_zero(each) else by * each for each in at)


def _sum(terms: Iterable[Array | float]) -> Array | float:
    present = [term for term in terms if not _is_zero(term)]
    return reduce(operator.add, present) if present else 0.0


def _is_zero(number: Array | float) -> bool:
    """Whether it is the number 0, and no array."""
    return isinstance(number, float) and number == 0


def _joint(model: mujoco.MjModel, joint: int) -> _Joint:
    """A hinge turns about its axis through its anchor (Rodrigues 1840); a slide moves along its axis."""
    axis, reference = model.jnt_axis[joint], float(model.qpos0[model.jnt_qposadr[joint]])
    if model.jnt_type[joint] == SLIDE:
        return _Joint(reference, np.eye(4), ((np.positive, _transform(np.zeros((3, 3)), axis, 0)),))
    x, y, z = axis
    cross, along = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.outer(axis, axis)
    there, back = (_transform(np.eye(3), sign * model.jnt_pos[joint]) for sign in (1, -1))
    sine, cosine = (there @ _transform(part, corner=0) @ back for part in (cross, np.eye(3) - along))
    return _Joint(reference, there @ _transform(along) @ back, ((np.sin, sine), (np.cos, cosine)))


def _still(model: mujoco.MjModel, joint: int, qpos: Array) -> Array:
    """The transform (4, 4) of a joint that is no motor's, and stays where it is in qpos (nq,)."""
    at = int(model.jnt_qposadr[joint])
    if model.jnt_type[joint] != BALL:
        return _joint(model, joint)(qpos[at])
    there, back = (_transform(np.eye(3), sign * model.jnt_pos[joint]) for sign in (1, -1))
    return np.asarray(there @ _transform(rotation_matrix(qpos[at : at + 4])) @ back)


def _transform(rotation: Array, offset: Array | float = 0.0, corner: float = 1.0) -> Array:
    """A homogeneous transform (4, 4); with another `corner` than 1, a part of such a one in a sum."""
    transform = np.zeros((4, 4))
    transform[:3, :3], transform[:3, 3], transform[3, 3] = rotation, offset, corner
    return transform
