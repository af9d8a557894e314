"""What an arm can run into: a table, three walls, and itself."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array
from calfree_gym.robot.arms.chain import HINGE, SLIDE, path_to
from calfree_gym.robot.arms.robot import Robot

ROOM_BODY = "calfree room"
"""Name of the body that table and walls are fixed to."""
SENSOR = "calfree touch"
"""Name of the sensor that tells how many contacts the arm has, and the largest force of one."""
TABLE = "table"
"""Name of the table of the arm that brings one, the RV-M2."""
ROOM = (ROOM_BODY, TABLE)
"""Beginnings of the names of what stands around an arm."""
GAP = 0.15
"""Walls stand so far (m) beyond the farthest places of objects, for the RV-M2. Choice: what swings out
beyond the gripper point, wild tilts included, finds room where the gripper goes straight to an object."""
BESIDE = 0.05
"""They stand at least so far (m, for the RV-M2) beyond the arm at home, and the table of an arm that brings
none lies so far below it. Choice."""
LOW_SHARE = 0.1
"""And below all but this share of the places that the gripper can be brought to. Choice: some cannot be
reached."""
CLEARANCE = 0.03
"""At home nothing is nearer (m, for the RV-M2) to table and walls. Choice: what is off by as much as first
motions are touches nothing."""
HALF = 0.02
"""Half the thickness of table and walls (m), as of the RV-M2's table."""
POSTURES = 500
"""So many drawn postures tell where objects are placed."""
LIGHTER = 0.2
"""Of the armature and the stiffness that servos have where nothing is touched. Source: the RV-M2's then are
as in grasping; at the gripper that is 25 N/mm, which is about what small arms have."""
_COUNT_AND_FORCE, _LARGEST = 0b11, 2
"""What a contact sensor reports: how many there are, and the force of the one with the largest."""
_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


class Furniture:
    """Puts table and walls around an arm, and lets all of them and the arm's own links touch.

    What is nearer to the arm or its links to each other than `CLEARANCE` at home is built so: these pairs do
    not count, for the shapes by which models collide are fuller than links are. Geoms collide that the model
    lets collide; of an arm that lets none, all.

    Args:
        robot: The arm.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def __call__(self, spec: Any) -> None:
        """Furnishes the spec of a bare arm, see `Robot.scene`."""
        first = spec.body(self._robot.bodies[0])
        spec.option.disableflags &= ~_CONTACT
        _let_touch(spec)
        _lighten(spec)
        self._add_room(spec)
        sensor = spec.add_sensor(
            name=SENSOR,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objname=first.name,
            objtype=mujoco.mjtObj.mjOBJ_XBODY,
        )
        sensor.intprm = [_COUNT_AND_FORCE, _LARGEST, 1]
        self._forgive_what_is_built_so(spec)

    def _add_room(self, spec: Any) -> None:
        """Table and walls; in front of the arm, and at its sides."""
        robot, up = self._robot, np.array([0.0, 0.0, 1.0])
        points = places(robot)
        scale, base = robot.rig.scale, robot.home_frame(robot.bodies[0])[0]
        ahead = (robot.rig.target - base) * [1, 1, 0]
        far = float(np.linalg.norm(ahead))
        ahead = ahead / far if far > 0.1 * scale * GAP else np.array([1.0, 0.0, 0.0])
        aside = np.cross(up, ahead)
        plain, body = mujoco.MjSpec(), spec.worldbody.add_body(name=ROOM_BODY)

        def add(name: str, middle: Array, size: Array) -> None:
            turn = np.arctan2(ahead[1], ahead[0]) / 2
            body.add_geom(
                plain.default,
                name=f"{ROOM_BODY} {name}",
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=middle,
                quat=[np.cos(turn), 0, 0, np.sin(turn)],
                size=size,
                rgba=[0.75, 0.78, 0.80, 0.15],
                mass=0.0,
                contype=1,
                conaffinity=1,
            )

        wide, gap = 6 * scale * GAP, scale * GAP
        model, data = at_home(spec, robot)
        own = of_arm(model, robot)
        beside = scale * BESIDE
        bottom = 0.0
        if spec.geom(TABLE) is None:
            lowest = -_farthest(model, data, -up, model.body_weldid[model.geom_bodyid] > 0) - beside
            bottom = min(lowest, float(np.quantile(points[:, 2], LOW_SHARE)))
            add("table", robot.rig.target * [1, 1, 0] + [0, 0, bottom - HALF], np.array([wide, wide, HALF]))
        middle = robot.rig.target * [1, 1, 0] + (bottom + wide) * up
        for name, way, flat in (
            ("front", ahead, [HALF, wide, wide]),
            ("left", aside, [wide, HALF, wide]),
            ("right", -aside, [wide, HALF, wide]),
        ):
            of_places = float((points @ way).max()) + gap
            distance = max(of_places, _farthest(model, data, way, own) + beside) + HALF
            add(f"{name} wall", middle + (distance - float(middle @ way)) * way, np.array(flat))

    def _forgive_what_is_built_so(self, spec: Any) -> None:
        model, data = at_home(spec, self._robot)
        near = CLEARANCE * self._robot.rig.scale
        keep_apart(model, of_arm(model, self._robot), near)
        mujoco.mj_collision(model, data)
        room = of_room(model)[data.contact.geom].any(1)
        built_so = data.contact.dist <= np.where(room, 0.0, near)
        pairs = np.sort(model.geom_bodyid[data.contact.geom[built_so]], axis=1)
        for one, other in np.unique(pairs, axis=0):
            spec.add_exclude(bodyname1=model.body(one).name, bodyname2=model.body(other).name)


@lru_cache(maxsize=8)
def furniture(robot: Robot) -> Furniture:
    """That of an arm; the same for the same arm."""
    return Furniture(robot)


def places(robot: Robot) -> Array:
    """Where objects are placed (n, 3), as the arm is built."""
    shares = np.random.default_rng(3).random((POSTURES, len(robot.motors)))
    angles = robot.angles(robot.postures(shares), robot.rest(np.zeros(len(robot.joints))))
    points = robot.gripper_position(angles, robot.lengths)
    return np.asarray(points[robot.within(points)])


def of_arm(model: mujoco.MjModel, robot: Robot) -> NDArray[np.bool_]:
    """Which geoms are of the arm, and not of what stands around it."""
    first = model.body(robot.bodies[0]).id
    return np.array([first in path_to(model, body) for body in model.geom_bodyid])


def of_room(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms are table and walls."""
    return np.array([model.geom(geom).name.startswith(ROOM) for geom in range(model.ngeom)])


def keep_apart(model: mujoco.MjModel, geoms: NDArray[np.bool_], distance: float) -> None:
    """Makes contacts of what is nearer to these geoms than so much (m), and of some that is not."""
    model.geom_margin[geoms] = distance
    # else bodies are not compared that are farther apart
    model.body_margin[model.geom_bodyid[geoms]] = distance


def at_home(spec: Any, robot: Robot) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The compiled spec, with the arm at home as built, and what touches there."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.home_qpos
    mujoco.mj_fwdPosition(model, data)
    return model, data


def _farthest(model: mujoco.MjModel, data: mujoco.MjData, way: Array, geoms: NDArray[np.bool_]) -> float:
    """How far the boxes about those of `geoms` that collide reach in a direction (3,), in m."""
    geoms = geoms & (model.geom_contype > 0)
    axes = data.geom_xmat.reshape(-1, 3, 3)[geoms]
    boxes = model.geom_aabb[geoms]
    middles = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", axes, boxes[:, :3])
    halves = (np.abs(np.einsum("i,gij->gj", way, axes)) * boxes[:, 3:]).sum(1)
    return float((middles @ way + halves).max(initial=-np.inf))


def _let_touch(spec: Any) -> None:
    geoms = list(spec.geoms)
    if not any(geom.contype or geom.conaffinity for geom in geoms if geom.parent.name != "world"):
        for geom in geoms:
            geom.contype = 1
    for geom in geoms:
        if geom.contype or geom.conaffinity:
            geom.contype = geom.conaffinity = 1


def _lighten(spec: Any) -> None:
    for joint in spec.joints:
        if joint.type in (HINGE, SLIDE):
            joint.armature *= LIGHTER
    for servo in spec.actuators:
        servo.gainprm[0] *= LIGHTER
        servo.biasprm[1] *= LIGHTER
