"""The marks by which gripper and object are seen: three balls, which a camera can tell apart.

The gripper's two balls stand on either side of the gripper point, which is the middle between them, and the
object's ball fits between them: so all three are seen at the rendezvous, where one ball on the gripper point
would hide the object's. Marks weigh nothing and touch nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import rounded
from calfree_gym.robot.rays import MARKS, MARKS_GROUP, shares_in_sight

COLOURS = ((0.95, 0.05, 0.55), (0.10, 0.20, 0.95), (0.05, 0.70, 0.25))
"""Red, green and blue of the marks: hues far apart, and far more saturated than a room is."""
EMISSION = 0.3
"""Marks glow a little, so that their dark side keeps its hue."""
RADIUS = 0.012
"""Of a ball of the RV-M2's (m)."""
HALF_APART = 0.050
"""From the gripper point to each of the RV-M2's gripper marks (m)."""
BAR = 0.0012
"""Radius of the bar that holds the gripper marks of an arm of the RV-M2's size (m)."""
_AXES = np.array([axis for axis in np.ndindex(3, 3, 3) if axis > (1, 1, 1)]) - 1.0


class GripperMarks(NamedTuple):
    """Where the gripper's marks are.

    Attributes:
        axis: From the gripper point to the first mark (3,), of unit length, in the frame of the gripper's
            body.
        scale: How large they and their distance are, relative to the RV-M2's.
    """

    axis: Array
    scale: float = 1.0

    @property
    def offsets(self) -> Array:
        """From the gripper point to both marks (2, 3) in m."""
        return np.outer([1.0, -1.0], HALF_APART * self.scale * self.axis)


def add_marks(spec: Any, gripper: Any, at: Array, marks: GripperMarks, prefix: str) -> None:
    """Adds the object, which is its mark, the gripper's marks, and the points of both.

    Args:
        spec: Of the arm; it is changed.
        gripper: The gripper's body.
        at: Where in that body the gripper point is (3,).
        marks: Where the marks are.
        prefix: Of all names that are added.
    """
    item = spec.worldbody.add_body(name=prefix + "object", mocap=True)
    plain = mujoco.MjSpec()  # the model's own defaults would colour them
    for body, name, where in ((gripper, "gripper", at), (item, "object", np.zeros(3))):
        body.add_site(plain.default, name=f"{prefix}{name}_point", pos=where, rgba=[0, 0, 0, 0])
    places = [(gripper, at + offset) for offset in marks.offsets] + [(item, np.zeros(3))]
    for name, colour, (body, where) in zip(MARKS, COLOURS, places, strict=True):
        spec.add_material(name=prefix + name, rgba=[*colour, 1], emission=EMISSION)
        body.add_geom(
            plain.default,
            name=prefix + name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=where,
            size=[RADIUS * marks.scale, 0, 0],
            material=prefix + name,
            group=MARKS_GROUP,
            mass=0.0,
            contype=0,
            conaffinity=0,
        )


def add_bar(gripper: Any, at: Array, marks: GripperMarks, prefix: str) -> None:
    """Adds the bar that holds the gripper's marks, where the arm has nothing that does."""
    gripper.add_geom(
        mujoco.MjSpec().default,
        name=prefix + "bar",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*(at + marks.offsets[0]), *(at + marks.offsets[1])],
        size=[BAR * marks.scale, 0, 0],
        rgba=[0.2, 0.2, 0.2, 1],
        mass=0.0,
        contype=0,
        conaffinity=0,
    )


def best_axis(
    model: mujoco.MjModel, postures: Array, holder: int, at: Array, cameras: Array, scale: float
) -> Array:
    """The axis (3,) on which both marks are seen best: seldom hidden by the arm, and far apart in the images.

    Args:
        model: Of the arm without marks.
        postures: Positions of all joints (n, nq), drawn in the work space.
        holder: The gripper's body.
        at: Where in it the gripper point is (3,).
        cameras: Optical centres (2, 3), in the room.
        scale: As in `GripperMarks`.
    """
    data = mujoco.MjData(model)
    axes = _AXES / np.linalg.norm(_AXES, axis=1, keepdims=True)
    scores = np.zeros(len(axes))
    for qpos in postures:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[holder].reshape(3, 3)
        point = data.xpos[holder] + turn @ at
        for camera in cameras:
            sight = (point - camera) / np.linalg.norm(point - camera)
            for i, axis in enumerate(axes):
                places = point + GripperMarks(turn @ axis, scale).offsets
                shares = shares_in_sight(model, data, camera, places, RADIUS * scale)
                scores[i] += shares.min() * np.linalg.norm(np.cross(sight, turn @ axis))
    return np.asarray(axes[rounded(scores).argmax()])
