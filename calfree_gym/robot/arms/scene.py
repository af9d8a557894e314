"""The scene around an arm: cameras, light, room, marks at its gripper, and sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import CAMERAS, IMAGE_SIZE, rounded
from calfree_gym.robot.arms.chain import BALL, FREE, HINGE, SLIDE
from calfree_gym.robot.arms.robot import ROOM, Furnish, Mounts, Scene
from calfree_gym.robot.rays import MARKS, MARKS_GROUP, RIG_GROUP, shares_in_sight

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
    offsets = np.concatenate([GripperMarks(axis, scale).offsets for axis in axes])
    scores = np.zeros(len(axes))
    for qpos in postures:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[holder].reshape(3, 3)
        point = data.xpos[holder] + turn @ at
        for camera in cameras:
            sight = (point - camera) / np.linalg.norm(point - camera)
            shares = shares_in_sight(model, data, camera, point + offsets @ turn.T, RADIUS * scale)
            apart = np.linalg.norm(np.cross(sight, axes @ turn.T), axis=1)
            scores += shares.reshape(-1, 2).min(1) * apart
    return np.asarray(axes[rounded(scores).argmax()])


PREFIX = "calfree "
"""Of the names of all that is added to a model of other people's."""
POINTS = ("gripper", "object")
KINDS = (mujoco.mjtSensor.mjSENS_CAMPROJECTION, mujoco.mjtSensor.mjSENS_FRAMEPOS)
"""Of sensors: image points, and places in the cameras' frames, of which the depth is used."""
SENSOR_SIZE = 0.01
"""Of a camera in m; it decides nothing."""
IMMOVABLE = 1e6
"""So much heavier than the arm are free bodies and balls, which no servo can hold."""
TIMESTEP = 0.005
STIFFNESS = 40_000.0
"""Of a servo, for an armature of 1: with `FILTER` it settles in a motion, as the RV-M2's do."""
FILTER = 0.03
"""Time constant (s) of the first-order filter through which a servo's target goes."""
_OFF = ("CONTACT", "FRICTIONLOSS", "LIMIT", "SPRING", "DAMPER")
_FOREIGN = 30
"""Actuator group of the model's own actuators, which is switched off."""


def build(
    spec: Any,
    motors: Sequence[str],
    gripper: tuple[str, Array],
    mounts: Mounts,
    home_qpos: Array,
    marks: GripperMarks,
    furnish: Furnish | None = None,
) -> Scene:
    """The scene of an arm.

    Args:
        spec: Of the arm, in which all bodies and joints have names.
        motors: Names of the joints that move.
        gripper: Name of the gripper's body, and where in it the gripper point is (3,).
        mounts: Names of the bodies to which the cameras are fixed.
        home_qpos: Of all joints (nq,).
        marks: Where the gripper's marks are.
        furnish: See `Robot.scene`.
    """
    spec = spec.copy()
    add_servos(spec, motors, home_qpos)
    if furnish is not None:
        furnish(spec)
    body, at = spec.body(gripper[0]), gripper[1]
    add_marks(spec, body, at, marks, PREFIX)
    add_bar(body, at, marks, PREFIX)
    add_rig(spec, mounts, PREFIX)
    add_sensors(spec, PREFIX)
    add_surroundings(spec, PREFIX)
    covers = _add_sky(spec)
    model, stepped = compiled_scene(spec)
    servos = [i for i in range(model.nu) if model.actuator(i).name.startswith(PREFIX)]
    targets = home_qpos[model.jnt_qposadr[model.actuator_trnid[servos, 0]]]
    ctrl, act = np.zeros(model.nu), np.zeros(model.na)
    ctrl[servos] = act[model.actuator_actadr[servos]] = targets
    return Scene(
        model,
        stepped,
        home_qpos,
        ctrl,
        act,
        qpos=np.array([model.joint(name).qposadr[0] for name in motors]),
        actuators=np.array([model.actuator(PREFIX + name).id for name in motors]),
        sensors=first_sensor(model, PREFIX),
        prefix=PREFIX,
        covers=covers,
    )


def compiled_scene(spec: Any) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The model of a spec, and what of it is stepped, see `Scene`."""
    model = spec.compile()
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return model, model
    spec = spec.copy()
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for light in list(spec.lights):
        spec.delete(light)
    spec.compiler.discardvisual = True  # bodies keep the inertia that their shapes gave them
    try:
        return model, spec.compile()
    except ValueError:  # something needs shapes, as inertiafromgeom="true" does
        return model, model


def first_sensor(model: mujoco.MjModel, prefix: str = "") -> int:
    """Where the numbers of the sensors that `add_sensors` added begin."""
    return int(model.sensor(sensor_name(prefix, POINTS[0], CAMERAS[0], KINDS[0])).adr[0])


def sensor_name(prefix: str, point: str, camera: str, kind: Any) -> str:
    """Name of the sensor of this kind that looks at a point from a camera."""
    return f"{prefix}{point} {camera} {kind.name}"


def add_servos(spec: Any, motors: Sequence[str], home_qpos: Array) -> None:
    """Makes an arm stand at home and move by position servos alone, with its weight carried.

    The model's own actuators are switched off; they stay, for its sensors may name them. Gravity, friction,
    damping and springs are off: a robot's own controllers overcome them. Hinges and slides that are no motors
    are held at home by servos; free bodies and balls by their inertia. So the model's own equalities are not
    needed.

    Args:
        spec: Of the arm; it is changed. All its bodies and joints have names.
        motors: Names of the joints that move.
        home_qpos: Of all joints (nq,).
    """
    model = spec.copy().compile()
    armatures = _armatures(model, home_qpos)
    plain = mujoco.MjSpec()  # the model's own defaults would bound words and forces
    option = plain.option
    option.timestep, option.integrator, option.gravity = (
        TIMESTEP,
        mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
        [0] * 3,
    )
    option.disableactuator = 1 << _FOREIGN
    option.disableflags = sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in _OFF)
    spec.option = option
    for key in spec.keys:  # they keep their qpos; all else has other lengths now
        key.ctrl, key.act, key.mpos, key.mquat = [], [], [], []
    for actuator in spec.actuators:
        actuator.group = _FOREIGN
    for equality in spec.equalities:
        equality.active = False
    held = []
    for joint in spec.joints:
        if joint.type in (FREE, BALL):
            joint.armature = IMMOVABLE * max(*armatures, model.body_mass.sum())
            continue
        joint.armature = armatures[joint.type == SLIDE]
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        if joint.name not in motors:
            held.append(joint.name)
    for name in (*motors, *held):
        servo = spec.add_actuator(
            plain.default, name=PREFIX + name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        stiffness = STIFFNESS * armatures[spec.joint(name).type == SLIDE]
        servo.set_to_position(kp=stiffness, dampratio=1.0, timeconst=FILTER)


def add_rig(spec: Any, mounts: Mounts, prefix: str = "") -> None:
    """Adds the two cameras on thin rods.

    Args:
        spec: Of the arm; it is changed.
        mounts: Names of the bodies to which the left and the right camera are fixed.
        prefix: Of all names that are added.
    """
    plain = mujoco.MjSpec()
    for camera, mount in zip(CAMERAS, mounts, strict=True):
        fixed_to = spec.worldbody if mount == ROOM else spec.body(mount)
        fixed_to.add_camera(
            plain.default,
            name=prefix + camera,
            resolution=[IMAGE_SIZE, IMAGE_SIZE],
            sensor_size=[SENSOR_SIZE, SENSOR_SIZE],
            focal_length=[SENSOR_SIZE, SENSOR_SIZE],
        )
        for part, shape in (("rod", mujoco.mjtGeom.mjGEOM_CAPSULE), ("housing", mujoco.mjtGeom.mjGEOM_BOX)):
            fixed_to.add_geom(
                plain.default,
                name=f"{prefix}{camera}_{part}",
                type=shape,
                size=[0.006, 0.1, 0.1],
                rgba=[0.25, 0.27, 0.30, 1],
                group=RIG_GROUP,
                mass=0.0,
                contype=0,
                conaffinity=0,
            )


def add_sensors(spec: Any, prefix: str = "") -> None:
    """Adds the sensors that project the points of gripper and object into the cameras; see `add_rig`."""
    for kind in KINDS:
        for point in POINTS:
            for camera in CAMERAS:
                spec.add_sensor(
                    name=sensor_name(prefix, point, camera, kind),
                    type=kind,
                    objtype=mujoco.mjtObj.mjOBJ_SITE,
                    objname=f"{prefix}{point}_point",
                    reftype=mujoco.mjtObj.mjOBJ_CAMERA,
                    refname=prefix + camera,
                )


def add_surroundings(spec: Any, prefix: str = "") -> None:
    """Adds the lamp, which is the only light, and a thing that may stand in the way, which is not shown."""
    for light in spec.lights:
        light.active = False
    headlight = spec.visual.headlight  # gives the light that comes from everywhere
    headlight.active, headlight.diffuse, headlight.specular = True, [0.0] * 3, [0.0] * 3
    plain = mujoco.MjSpec()
    lamp = spec.worldbody.add_light(plain.default, name=prefix + "lamp")
    lamp.type, lamp.castshadow, lamp.specular = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, True, [0.1] * 3
    spec.worldbody.add_geom(
        plain.default,
        name=prefix + "occluder",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[1e-3, 1e-3, 0],  # small: it must not enlarge the model's extent
        rgba=[0.45, 0.42, 0.40, 0],
        contype=0,
        conaffinity=0,
    )


def _add_sky(spec: Any) -> tuple[str, ...]:
    """Surrounds an arm with a sky, where it has none; names the texture."""
    if any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        return ()
    spec.add_texture(
        name=PREFIX + "sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.70, 0.76, 0.83],
        width=64,
        height=64,
    )
    return (PREFIX + "sky",)


def _armatures(model: mujoco.MjModel, home_qpos: Array) -> tuple[float, float]:
    """The largest inertia of any hinge (kg m²), and of any slide (kg), at home.

    Every joint gets that much armature: so none is moved by the others, and all settle alike.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = home_qpos
    mujoco.mj_forward(model, data)
    masses = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, masses)
    of_kind = [
        [masses[dof, dof] for dof in model.jnt_dofadr[model.jnt_type == kind]] for kind in (HINGE, SLIDE)
    ]
    hinges, slides = (max(found, default=1.0) for found in of_kind)
    return float(hinges), float(slides)
