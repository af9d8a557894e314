"""The arm of the paper, a Mitsubishi Movemaster RV-M2: used where no other arm is given."""

from __future__ import annotations

from importlib.resources import files

import mujoco
import numpy as np

from calfree_gym.geometry import Array, Flags, points_of
from calfree_gym.robot.arms.robot import HINGE_SPEED, Furnish, Mounts, Rig, Robot, Scene
from calfree_gym.robot.arms.scene import (
    GripperMarks,
    add_marks,
    add_rig,
    add_sensors,
    add_surroundings,
    compiled_scene,
    first_sensor,
)

LINKS = ("base", "shoulder", "upper_arm", "forearm", "hand")
LENGTHS = np.array([0.40, 0.12, 0.25, 0.20, 0.25])
"""Nominal link lengths in m: base to shoulder (up), base to shoulder (forward), shoulder to elbow,
elbow to wrist, wrist to gripper point."""
MOTORS = ("waist", "shoulder", "elbow")
HOME = np.radians([0.0, 40.0, -80.0])
"""Joint angles (rad) of J1-J3 at registers zero, as the arm's own controller assumes them."""
SPAN = np.array([2.6, 2.0, 2.0])
"""Radians from home to register 1, at gain 1."""
JOINT_LIMITS = np.radians([[-150, 150], [-30, 100], [-120, 0], [-110, 110]])
"""Mechanical stops of J1-J4 (4, 2), as in assets/arm.xml."""
CAMERA_POSITION = np.array([[0.05, 0.35, 0.60], [0.05, -0.35, 0.60]])
"""Nominal optical centres in m, left and right of the work plane, with the waist at home."""
AIM = np.array([0.42, 0.0, 0.12])
"""Where the built robot's cameras look (m)."""
HEIGHT = (0.03, 0.25)
"""Objects lie between these heights above the table (m)."""
DISTANCE = (0.30, 0.50)
"""Objects lie between these distances from the waist's axis (m)."""
WAIST = 0.9
"""Objects lie within this angle of straight ahead (rad)."""
BEFORE_IT = f"{DISTANCE[0]} to {DISTANCE[1]} m from the waist's axis, within {WAIST} rad of straight ahead"
"""Both, as errors have it."""
LIMIT_MARGIN = 0.1
"""No object needs a joint nearer than this to its limit (rad)."""
_WRIST_LOWEST, _WRIST_HIGHEST = JOINT_LIMITS[3].tolist()
_HAND_TOGRIPPER_POINT = 0.18
GRIPPER_POINT = np.array([_HAND_TOGRIPPER_POINT, 0.0, 0.0])
COVERS = ("table", "sky")
_MARKS = GripperMarks(axis=np.array([0.0, 0.0, 1.0]))
"""Below the tips of the jaws, in assets/arm.xml, which have stalks for them."""
_STRETCHED = [3, 4, 5, 6]
"""Ids of upper arm, forearm, hand and gripper in assets/arm.xml."""


def gripper_position(joints: Array, link_lengths: Array) -> Array:
    """Gripper points (..., 3) in m, in the frame of the base.

    Args:
        joints: Angles of J1-J4 in rad (..., 4); J2 rises from the horizontal, J3 and J4 bend on.
        link_lengths: In m (..., 5), as in `World`.
    """
    base, shoulder, upper_arm, forearm, hand = (link_lengths[..., i] for i in range(5))
    angles = np.empty((4, *joints.shape[:-1]))  # of the waist, and of each link to the horizontal
    angles[0], angles[1] = joints[..., 0], joints[..., 1]
    angles[2] = angles[1] + joints[..., 2]
    angles[3] = angles[2] + joints[..., 3]
    (c, *along), (s, *up) = np.cos(angles), np.sin(angles)
    radius = shoulder + upper_arm * along[0] + forearm * along[1] + hand * along[2]
    height = base + upper_arm * up[0] + forearm * up[1] + hand * up[2]
    return points_of(radius * c, radius * s, height)


class Movemaster(Robot):
    """Three motors turn J1-J3.

    The wrist (J4) is no motor of the controller: the arm itself holds the gripper vertical, as in the paper's
    section 2.1, from its own joint angles, and so tilts it where its joint zeros are wrong. J5 stays.
    """

    motors: tuple[str, ...] = MOTORS
    joints: tuple[str, ...] = ("J1", "J2", "J3", "J4")
    links = LINKS
    lengths = LENGTHS
    slides = np.zeros(3, bool)
    home = HOME
    home_qpos = np.radians([0.0, 40.0, -80.0, -50.0, 0.0])
    span = SPAN
    stops = JOINT_LIMITS[:3]
    stop_margin = np.full(3, 0.01)
    lowest = np.concatenate([[-WAIST], JOINT_LIMITS[1:3, 0] + LIMIT_MARGIN])
    highest = np.concatenate([[WAIST], JOINT_LIMITS[1:3, 1] - LIMIT_MARGIN])
    rig = Rig(CAMERA_POSITION, AIM, 1.0)
    candidates = 10_000
    speeds = np.full(5, HINGE_SPEED)
    _bodies = ["waist", "upper_arm", "forearm", "hand", "gripper"]  # noqa: RUF012

    @property
    def bodies(self) -> list[str]:
        """See `Robot`."""
        return self._bodies

    @property
    def built_home(self) -> Array:
        """See `Robot`."""
        return self.angles(HOME, self.rest(np.zeros(4)))

    def rest(self, zeros: Array) -> Array:
        """See `Robot`: the wrist's angle with J2 and J3 at zero."""
        return np.array([-np.pi / 2 + zeros[1:4].sum()])

    def angles(self, positions: Array, rest: Array) -> Array:
        """See `Robot`: J1-J5 in rad."""
        angles = np.zeros((*positions.shape[:-1], 5))
        angles[..., :3] = positions
        wrist = rest[..., 0] - positions[..., 1] - positions[..., 2]
        angles[..., 3] = np.minimum(np.maximum(wrist, _WRIST_LOWEST), _WRIST_HIGHEST)
        return angles

    def gripper_position(self, angles: Array, lengths: Array) -> Array:
        """See `Robot`."""
        return gripper_position(angles, lengths)

    def within(self, points: Array) -> Flags:
        """See `Robot`."""
        height, distance = points[..., 2], np.hypot(points[..., 0], points[..., 1])
        return (
            (height >= HEIGHT[0])
            & (height <= HEIGHT[1])
            & (distance >= DISTANCE[0])
            & (distance <= DISTANCE[1])
        )

    def frames(self, body: str, angles: Array, lengths: Array) -> tuple[Array, Array]:
        """See `Robot`."""
        base, shoulder, upper_arm, forearm, hand = (lengths[..., i] for i in range(5))
        waist = angles[..., 0]
        upper, fore, grip = np.moveaxis(np.cumsum(angles[..., 1:4], -1), -1, 0)
        radius, height, rise = np.zeros_like(waist), np.zeros_like(waist), np.zeros_like(waist)
        place = self.bodies.index(body)
        if place:
            radius, height, rise = radius + shoulder, height + base, upper
        ways = ((upper_arm, upper, fore), (forearm, fore, grip), (hand - _HAND_TOGRIPPER_POINT, grip, grip))
        for length, along, then in ways[: max(place - 1, 0)]:
            radius, height, rise = radius + length * np.cos(along), height + length * np.sin(along), then
        c, s, up, level = np.cos(waist), np.sin(waist), np.sin(rise), np.cos(rise)
        axes = np.stack([level * c, -s, -up * c, level * s, c, -up * s, up, np.zeros_like(up), level], -1)
        return np.stack([radius * c, radius * s, height], -1), axes.reshape(*waist.shape, 3, 3)

    def into_mounts(self, points: Array, angles: Array, lengths: Array, mounts: Mounts) -> Array:
        """See `Robot`."""
        if mounts != ("waist", "waist"):
            return super().into_mounts(points, angles, lengths, mounts)
        c, s = np.cos(angles[..., 0]), np.sin(angles[..., 0])
        x, y, z = (points[..., axis] for axis in range(3))
        return points_of(c * x + s * y, c * y - s * x, z)[..., None, :]

    def scene(self, mounts: Mounts, furnish: Furnish | None = None) -> Scene:
        """See `Robot`."""
        spec = mujoco.MjSpec.from_file(str(files("calfree_gym") / "assets" / "arm.xml"))
        if furnish is not None:
            furnish(spec)
        add_marks(spec, spec.body("gripper"), GRIPPER_POINT, _MARKS, prefix="")
        add_rig(spec, mounts)
        add_sensors(spec)
        add_surroundings(spec)
        (model, stepped), still, places = compiled_scene(spec), np.zeros(5), np.arange(5)
        sensors = first_sensor(model)
        return Scene(model, stepped, still, still, still, places, places, sensors, prefix="", covers=COVERS)

    def stretch(self, body_positions: Array, lengths: Array) -> None:
        """See `Robot`."""
        base, shoulder, upper_arm, forearm, hand = lengths
        offsets = (
            (shoulder, 0, base),
            (upper_arm, 0, 0),
            (forearm, 0, 0),
            (hand - _HAND_TOGRIPPER_POINT, 0, 0),
        )
        body_positions[_STRETCHED] = offsets


MOVEMASTER = Movemaster()
