"""The paper's arm with a gripper: its jaws, table and things as MuJoCo has them, and its coloured marks."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import mujoco
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.robot.arms.movemaster import COVERS, GRIPPER_POINT, JOINT_LIMITS, LIMIT_MARGIN, Movemaster
from calfree_gym.robot.arms.robot import Furnish, Mounts, Scene
from calfree_gym.robot.arms.scene import EMISSION, STIFFNESS, add_rig, add_surroundings
from calfree_gym.robot.rays import MARKS_GROUP

STROKE = 0.042
"""By how much each jaw opens (m)."""
OPENING = 2 * STROKE
"""Between the open jaws (m)."""
GRIP = 30.0
"""Each jaw presses with this force (N)."""
GIVES_WAY = 0.045
"""The wrist gives way so far (m)."""
SPRING = 3_000.0
"""Of the wrist (N/m)."""
JAWS = ("jaw_1", "jaw_2")
BEYOND = 0.006
"""The pads end so far beyond the gripper point (m)."""
RAIL, SLIDES = 0.088, 0.096
"""From the hand to the middle of the rail, the gripper's base, and to where jaws slide on it (m)."""
FINGERS = 0.126
"""From the hand to the middle of the jaws' upper ends (m)."""
AXIS = 0.092
"""From the gripper point back to the gripper's base (m): the jaws' opening, and a little."""
PAD = np.array([0.020, 0.016, 0.004])
"""Half of a pad's length along the gripper's axis, of its width, and of its thickness (m)."""
EDGE = 0.045
"""From the gripper's axis to each of its edges' marks (m)."""
OF_GRIPPER, OF_SURFACES = 2, 1
"""Bits of what touches: the gripper touches surfaces, and not itself."""
HARD = {"solref": [0.02, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0]}
"""How contacts give way: within four steps of 5 ms. Measured: in half that time what slides on the table
bounces, with peaks of 400 N."""


def add_gripper(spec: Any, hand: Any, point: Array, beyond: float = BEYOND) -> None:
    """Replaces what is on a hand by a gripper that can hold, and adds its actuator.

    Args:
        spec: Of the arm; it is changed.
        hand: The body that the last joint turns about its x axis.
        point: Where in it the gripper point is (3,), on the axis.
        beyond: The pads end so far beyond that point (m).
    """
    plain = mujoco.MjSpec().default
    for geom in list(hand.geoms)[1:]:  # the flange stays
        spec.delete(geom)
    hand.explicitinertial = False
    palm = hand.add_body(plain, name="palm")
    palm.add_joint(
        plain,
        name="wrist_spring",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[1, 0, 0],
        stiffness=SPRING,
        damping=60,
        limited=True,
        range=[-GIVES_WAY, 0.005],
    )
    _add_box(palm, "palm_block", [0.045, 0, 0], [0.035, 0.024, 0.032], 0.3)
    _add_box(palm, "palm_rail", [RAIL, 0, 0], [0.008, 0.018, 0.055], 0.1)
    tip = point[0] + beyond
    for name, side in zip(JAWS, (1, -1), strict=True):
        jaw = palm.add_body(plain, name=name, pos=[SLIDES, 0, 0])
        jaw.add_joint(
            plain,
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0, 0, side],
            armature=0.2,
            damping=20,
        )
        length = tip - SLIDES
        finger, pad = length / 2, length - PAD[0]
        _add_box(jaw, f"{name}_finger", [finger, 0, side * 0.012], [finger, 0.008, 0.004], 0.05)
        box = _add_box(jaw, f"{name}_pad", [pad, 0, side * PAD[2]], PAD, 0.05)
        box.condim, box.priority = 4, 1
        jaw.add_site(plain, name=f"{name}_tip", pos=[pad, 0, side * 2 * PAD[2]], rgba=[0] * 4)
    palm.add_site(plain, name="gripper_point", pos=point, rgba=[0] * 4)
    palm.add_site(plain, name="gripper_base", pos=point - [AXIS, 0, 0], rgba=[0] * 4)
    for i, side in enumerate((1, -1)):
        palm.add_site(plain, name=f"edge_{i + 1}", pos=[RAIL, side * EDGE, 0], rgba=[0] * 4)
    equality = spec.add_equality(
        plain,
        name="jaws",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=JAWS[0],
        name2=JAWS[1],
    )
    equality.data[:5] = [0, 1, 0, 0, 0]
    actuator = spec.add_actuator(
        plain, name="M6", target=JAWS[0], trntype=mujoco.mjtTrn.mjTRN_JOINT, forcelimited=True
    )
    actuator.set_to_position(kp=6_000.0)
    actuator.forcerange = [-2 * GRIP, 2 * GRIP]


def _add_box(body: Any, name: str, place: Any, size: Any, mass: float) -> Any:
    return body.add_geom(
        mujoco.MjSpec().default,
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=place,
        size=size,
        mass=mass,
        rgba=[0.22, 0.23, 0.26, 1],
        contype=OF_GRIPPER,
        conaffinity=OF_SURFACES,
        condim=3,
        **HARD,
    )


def add_table(spec: Any) -> None:
    """Adds the table as the gripper touches it: a plane."""
    plain = mujoco.MjSpec().default
    spec.worldbody.add_geom(
        plain,
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[2, 2, 0.1],
        rgba=[0] * 4,
        contype=OF_SURFACES,
        conaffinity=OF_SURFACES | OF_GRIPPER,
        condim=3,
        friction=[0.6, 0.005, 0.0001],
        **HARD,
    )


def add_thing(spec: Any) -> None:
    """Adds a thing of two parts that lies on the table."""
    plain = mujoco.MjSpec().default
    thing = spec.worldbody.add_body(plain, name="object")
    thing.add_freejoint(name="object")
    for name in ("object_1", "object_2"):
        thing.add_geom(
            plain,
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.1, 0.1, 0.1],
            pos=[0.0, 0.1 * (name == "object_2"), 0.0],
            mass=0.05,
            rgba=[0.85, 0.45, 0.10, 1],
            contype=OF_SURFACES,
            conaffinity=OF_SURFACES,
            condim=3,
            **HARD,
        )
    thing.add_site(plain, name="object_point", rgba=[0] * 4)
    for name in ("axis_1", "axis_2"):  # compiled away from the origin, else MuJoCo leaves them there
        thing.add_site(plain, name=name, pos=[0.1, 0.1, 0.1], rgba=[0] * 4)


COLOURS = {
    "jaw_1": (0.90, 0.05, 0.90),
    "jaw_2": (0.10, 0.20, 0.95),
    "edge_1": (0.95, 0.85, 0.05),
    "edge_2": (0.05, 0.80, 0.85),
    "fingers": (0.95, 0.10, 0.05),
    "object": (0.05, 0.70, 0.25),
}
"""Red, green and blue of the marks: six hues, about 60 degrees apart."""
RADIUS = 0.010
"""Of the balls (m)."""
FINGER = np.array([0.018, 0.011, 0.006])
"""Half of an upper end's length along the gripper's axis, of its width, and of its thickness (m)."""
_SKIN = 0.0005
"""So much larger than a jaw's lower end is what colours it (m)."""


def add_marks(spec: Any, thing: tuple[str, ...]) -> None:
    """Colours the jaws and the thing, and adds a ball at either edge.

    Args:
        spec: Of the arm and its gripper; it is changed.
        thing: Names of the geoms that the thing consists of.
    """
    box, ball = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
    for name, colour in COLOURS.items():
        spec.add_material(name=f"mark_{name}", rgba=[*colour, 1], emission=EMISSION)
    for name, side in zip(JAWS, (1, -1), strict=True):
        jaw = spec.body(name)
        _add(jaw, name, box, spec.site(f"{name}_tip").pos, PAD * [1, 1, 2] + _SKIN)
        _add(jaw, "fingers", box, [FINGERS - SLIDES, 0, side * 3 * PAD[2]], FINGER)
    palm = spec.body("palm")
    for name in ("edge_1", "edge_2"):
        _add(palm, name, ball, spec.site(name).pos, [RADIUS, 0, 0])
    palm.add_geom(
        mujoco.MjSpec().default,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[RAIL, -EDGE, 0, RAIL, EDGE, 0],
        size=[0.0012, 0, 0],
        rgba=[0.2, 0.2, 0.2, 1],
        mass=0.0,
        contype=0,
        conaffinity=0,
    )
    for part in thing:
        spec.geom(part).material, spec.geom(part).rgba = "mark_object", [*COLOURS["object"], 1]


def _add(body: Any, mark: str, kind: Any, at: Any, size: Any) -> None:
    body.add_geom(
        mujoco.MjSpec().default,
        type=kind,
        pos=at,
        size=size,
        material=f"mark_{mark}",
        group=MARKS_GROUP,
        mass=0.0,
        contype=0,
        conaffinity=0,
    )


MOTORS: tuple[str, ...] = (*Movemaster.motors, "wrist_turn")
TURN = 3.5
"""Radians from home to register 1 of the wrist's turn, at gain 1: half of that gain turns by 90 degrees."""
TORQUES = (25.0, 25.0, 20.0, 10.0, 3.0)
"""Of the servos of J1-J5 at most (N m): about what an arm of this size has beyond its own weight."""
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
        return Scene(model, model, qpos, ctrl, np.zeros(0), arm, servos, sensors=0, prefix="", covers=COVERS)

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


TILT = TURN
"""Radians from home to register 1 of the wrist's tilt, at gain 1: as of its turn."""
HOME = np.radians([0.0, 55.0, -80.0, -65.0, 0.0])
"""J1-J5 at registers zero: as built the gripper points straight down, above where things are held."""
HOLDER = np.array([5.0, 5.0, 5.0, 0.2, 0.2, 0.2])
"""What holds a thing in the air gives way to more than this (N, and N m). Choice: more than the heaviest
weighs, and far less than the jaws press."""

FIRM = 0.9999
"""Impedance of its friction. Measured: so things sink by 0.05 mm in a trial; by default, 11 mm a second."""


class TiltingArm(GrippingArm):
    """Five motors turn J1-J5. Nothing keeps the gripper vertical."""

    motors = (*Movemaster.motors, "wrist_tilt", "wrist_turn")
    joints = ("J1", "J2", "J3", "J4", "J5")
    slides = np.zeros(5, bool)
    home = HOME
    span = np.append(Movemaster.span, [TILT, TURN])
    stops = np.vstack([JOINT_LIMITS, np.radians([[-180, 180]])])
    stop_margin = np.full(5, 0.01)
    lowest = np.append(Movemaster.lowest, [JOINT_LIMITS[3, 0] + LIMIT_MARGIN, -np.pi / 2])
    highest = np.append(Movemaster.highest, [HOME[3] + np.pi / 2, np.pi / 2])

    def rest(self, zeros: Array) -> Array:
        """See `Robot`: nothing; the pitch of a gripper that points straight down."""
        return np.array([-np.pi / 2])

    def angles(self, positions: Array, rest: Array) -> Array:
        """See `Robot`: J1-J5 in rad, which are the motors' own."""
        return positions.copy()

    def positions_at(self, points: Array, rest: Array, lengths: Array) -> Array:
        """See `GrippingArm`: (k, 5), with the gripper at the pitch `rest` (1,)."""
        waist, rise, elbow, turn = super().positions_at(points, rest, lengths).T
        return np.stack([waist, rise, elbow, rest[0] - rise - elbow, turn], -1)

    def scene(self, mounts: Mounts, furnish: Furnish | None = None) -> Scene:
        """See `GrippingArm`: the thing is held in the air."""
        scene = super().scene(mounts, furnish)
        first = int(scene.model.joint("object").dofadr[0])
        held = slice(first, first + len(HOLDER))
        scene.model.dof_frictionloss[held], scene.model.dof_solimp[held, :2] = HOLDER, FIRM
        return scene
