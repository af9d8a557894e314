"""The paper's arm with a gripper that can hold: it turns the gripper about its axis, too (paper, 3.5)."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import mujoco
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.robot.arms.movemaster import COVERS, GRIPPER_POINT, Movemaster
from calfree_gym.robot.arms.robot import Furnish, Mounts, Scene
from calfree_gym.robot.arms.scene import add_rig, add_surroundings
from calfree_gym.robot.grasping.jaws import JAWS, STROKE, add_gripper, add_table, add_thing
from calfree_gym.robot.grasping.marks import add_marks

MOTORS: tuple[str, ...] = (*Movemaster.motors, "wrist_turn")
TURN = 3.5
"""Radians from home to register 1 of the wrist's turn, at gain 1: half of that gain turns by 90 degrees."""
TORQUES = (25.0, 25.0, 20.0, 10.0, 3.0)
"""Of the servos of J1-J5 at most (N m): about what an arm of this size has beyond its own weight."""
STIFFNESS = 40_000.0
"""Of a servo, for an armature of 1."""
ARMATURE = 0.1
SENSORS = ("force_table", "force_object", "net_table", "net_object")
_OFF = (
    mujoco.mjtDisableBit.mjDSBL_MIDPHASE,
    mujoco.mjtDisableBit.mjDSBL_AUTORESET,
    mujoco.mjtDisableBit.mjDSBL_ISLAND,
)
"""Bounding volumes are those of compiled things, not of those that lie there; what diverges must show; and to
find what touches each other takes longer than to solve all at once."""
_LARGEST, _NET = 2, 3
"""What a contact sensor reports of several contacts: the largest force, or all together."""


class GrippingArm(Movemaster):
    """Four motors turn J1-J3 and J5; the jaws have a register of their own, which is no secret.

    The turn of the wrist changes neither the gripper point nor what it is to reach.

    Attributes:
        opening: How far each jaw is open at home (m).
    """

    motors = MOTORS
    joints = ("J1", "J2", "J3", "J5", "J4")
    slides = np.zeros(4, bool)
    home = np.append(Movemaster.home, 0.0)
    span = np.append(Movemaster.span, TURN)
    stops = np.vstack([Movemaster.stops, np.radians([[-180, 180]])])
    stop_margin = np.full(4, 0.01)
    lowest = np.append(Movemaster.lowest, -np.pi / 2)
    highest = np.append(Movemaster.highest, np.pi / 2)
    opening = STROKE

    @property
    def built_home(self) -> Array:
        """See `Robot`."""
        return self.angles(self.home, self.rest(np.zeros(5)))

    def rest(self, zeros: Array) -> Array:
        """See `Robot`: the wrist's angle with J2 and J3 at zero."""
        return np.array([-np.pi / 2 + zeros[1] + zeros[2] + zeros[4]])

    def angles(self, positions: Array, rest: Array) -> Array:
        """See `Robot`: J1-J5 in rad."""
        angles = super().angles(positions[..., :3], rest)
        angles[..., 4] = positions[..., 3]
        return angles

    def positions_at(self, points: Array, rest: Array, lengths: Array) -> Array:
        """Where motors' joints must be (k, 4) for the gripper to be at points (k, 3), if it can be there.

        Args:
            points: In the room, in m.
            rest: What `rest` says of the world: the gripper's pitch, which the arm keeps.
            lengths: Of the links (5,).
        """
        base, shoulder, upper_arm, forearm, hand = lengths
        pitch = rest[0]
        forward = np.hypot(points[:, 0], points[:, 1]) - shoulder - hand * np.cos(pitch)
        up = points[:, 2] - base - hand * np.sin(pitch)
        squares = forward**2 + up**2 - upper_arm**2 - forearm**2
        elbow = -np.arccos(np.clip(squares / (2 * upper_arm * forearm), -1, 1))
        across = forearm * np.sin(elbow)
        rise = np.arctan2(up, forward) - np.arctan2(across, upper_arm + forearm * np.cos(elbow))
        waist = np.arctan2(points[:, 1], points[:, 0])
        return np.stack([waist, rise, elbow, np.zeros_like(waist)], -1)

    def axis(self, angles: Array) -> Array:
        """The direction (..., 3) in which the gripper points, at joints (..., 5)."""
        pitch = angles[..., 1] + angles[..., 2] + angles[..., 3]
        level = np.cos(pitch)
        waist = angles[..., 0]
        return np.stack([level * np.cos(waist), level * np.sin(waist), np.sin(pitch)], -1)

    def scene(self, mounts: Mounts, furnish: Furnish | None = None) -> Scene:
        """See `Robot`: with contacts, and a thing to be grasped; joints are J1-J5."""
        spec = mujoco.MjSpec.from_file(str(files("calfree_gym") / "assets" / "arm.xml"))
        if furnish is not None:
            furnish(spec)
        option = spec.option
        option.disableflags = sum(map(int, _OFF))
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10
        for number, torque in enumerate(TORQUES, 1):
            spec.joint(f"J{number}").armature = ARMATURE
            servo = spec.actuator(f"M{number}")
            servo.set_to_position(kp=STIFFNESS * ARMATURE, dampratio=1.0)
            servo.forcelimited, servo.forcerange = True, [-torque, torque]
        self.furnish(spec)
        add_rig(spec, mounts)
        add_surroundings(spec)
        _add_sensors(spec)
        model = spec.compile()
        qpos = np.array(model.qpos0)
        arm = np.array([model.joint(f"J{number}").qposadr[0] for number in range(1, 6)])
        servos = np.array([model.actuator(f"M{number}").id for number in range(1, 6)])
        ctrl = np.zeros(model.nu)
        qpos[arm] = ctrl[servos] = self.built_home
        for jaw in JAWS:
            qpos[model.joint(jaw).qposadr[0]] = self.opening
        ctrl[model.actuator("M6").id] = self.opening
        return Scene(model, qpos, ctrl, np.zeros(0), arm, servos, sensors=0, prefix="", covers=COVERS)

    def furnish(self, spec: Any) -> None:
        """Adds the gripper, what it touches, and marks, to the arm's `spec`."""
        add_gripper(spec, spec.body("gripper"), GRIPPER_POINT)
        add_table(spec)
        add_thing(spec)
        add_marks(spec, ("object_1", "object_2"))


def _add_sensors(spec: Any) -> None:
    """Adds sensors of the forces between the gripper, and table or object: the largest, and all together."""
    body = mujoco.mjtObj.mjOBJ_XBODY
    for name in SENSORS:
        other = ("ground", mujoco.mjtObj.mjOBJ_GEOM) if name.endswith("table") else ("object", body)
        sensor = spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objname=other[0],
            objtype=other[1],
            refname="palm",
            reftype=body,
        )
        sensor.intprm = [2, _LARGEST if name.startswith("force") else _NET, 1]
