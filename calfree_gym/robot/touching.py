"""Arms that can touch table, walls and themselves: what stands around them, and their physics."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.arms.chain import HINGE, SLIDE, path_to
from calfree_gym.robot.arms.robot import Mounts, Robot, kept_with_robot
from calfree_gym.robot.grasping.simulation import PEAK, smooth
from calfree_gym.robot.simulation import ReachSimulation

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


@kept_with_robot
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


SPEED = 0.25
"""The gripper's speed (m/s) at most. Source: ISO 10218-1, reduced speed, at which a robot is set up."""
LEAST = 70
"""Substeps of the shortest motion: 0.35 s, as in grasping."""
SETTLING = 40
"""Substeps after it: an arm then has settled to 0.1 pixels (a test measures it)."""
TRIP = 12.0
"""A drive trips where a contact presses by this force (N): as the guard in grasping."""
REACTION = 2
"""Substeps until it stops. Choice: 10 ms."""
RETREAT = 0.5
"""It then goes back by this share of the way that it has come: as in grasping."""
ON_THE_WAY = 8
"""Places on the way to an object at which the arm must touch nothing, nor come nearer to table and walls than
`CLEARANCE`. Choice: a few cm apart."""


class Touched(NamedTuple):
    """What became of a motion.

    Attributes:
        shares: Of the way (n,), in joints: less than 1 where the drive tripped.
        force: Largest force of a contact (n,) in N.
        contacts: At how many points the arm touched something (n,), at most.
        travel: How far the joint that went farthest was from where it began (n,), in rad or m.
    """

    shares: Array
    force: Array
    contacts: Array
    travel: Array


class Passed(NamedTuple):
    """What arms went through, substep by substep.

    Attributes:
        forces: Largest force of a contact (n, k) in N.
        contacts: How many there were (n, k).
        joints: Positions of the joints (n, k, j).
    """

    forces: Array
    contacts: Array
    joints: Array


class TouchingSimulation(ReachSimulation):
    """Arms that reach, and can touch table, walls and themselves.

    Servos are those of `ReachSimulation`. Their targets travel with least jerk, the gripper at no more than
    `SPEED`. A drive that trips holds the arm where it is, and takes it back by half of the way.

    Args:
        rows, robot, mounts, threads: See `Simulation`.
    """

    state_names: ClassVar[tuple[str, ...]] = (*ReachSimulation.state_names, "_touched")

    def __init__(self, rows: int, robot: Robot, mounts: Mounts, threads: int) -> None:
        super().__init__(rows, robot, mounts, threads, furniture(robot))
        self._touch = int(self._model.sensor(SENSOR).adr[0])
        self._joints = np.atleast_1d(np.arange(self._model.nq)[self._qpos])
        self._touched = np.zeros((rows, len(Touched._fields)))
        self._picture = self.picture()
        model = self._picture[0]
        self._of_arm = of_arm(model, robot)
        keep_apart(model, of_room(model), CLEARANCE * robot.rig.scale)

    def move(self, rows: Rows, joints: Array) -> Array:
        """See `ReachSimulation`; where the drive trips, the arm stops short. `touched` tells."""
        travel = self.travel(rows, joints)
        which = np.arange(self.rows)[rows]
        before = self._all_ctrl[which].copy()
        way = np.zeros_like(before)
        way[:, self._ctrl] = joints - before[:, self._ctrl]
        long = self._substeps(which, before[:, self._ctrl], way[:, self._ctrl])
        start, home = self._physics[which].copy(), self.joints()[which]
        found = Touched(*(np.zeros(len(which)) for _ in Touched._fields))
        found.shares.fill(1.0)
        for count in sorted(set(long.tolist())):
            on = np.flatnonzero(long == count)
            control = before[on, None] + ramp(count)[:, None] * way[on, None]
            passed = self._follow(which[on], control)
            trips = (passed.forces > TRIP).argmax(1)
            for i, seen, trip in zip(on.tolist(), range(len(on)), trips.tolist(), strict=True):
                each = Passed(*(part[seen] for part in passed))
                if each.forces[trip] > TRIP:
                    stop = min(trip + 1 + REACTION, len(each.forces))
                    self._physics[which[i]] = start[i]
                    found.shares[i] = (1 - RETREAT) * ramp(count)[stop - 1]
                    each = self._stopped(
                        which[i : i + 1], control[seen, :stop], before[i], way[i], found.shares[i]
                    )
                found.force[i], found.contacts[i] = each.forces.max(), each.contacts.max()
                found.travel[i] = np.abs(each.joints - home[i]).max()
        self._touched[which] = np.stack(found, 1)
        return travel

    @property
    def touched(self) -> Touched:
        """What became of the last motion of all rows; writable."""
        return Touched(*self._touched.T)

    def _stopped(
        self, row: NDArray[np.intp], control: Array, before: Array, way: Array, share: float
    ) -> Passed:
        """Follows a control (k, nu) up to where the drive stops the arm of a row, and takes it back.

        Args:
            row: The row (1,).
            control: Up to there.
            before: Controls where the motion began (nu,).
            way: From there to where it was to end (nu,).
            share: Of the way, at which it is to rest.
        """
        onward = self._follow(row, control[None])
        here = before.copy()
        here[self._ctrl] = self._all_qpos[row[0], self._qpos]
        self._all_act[row[0], self._act] = here[self._ctrl]
        back = here + ramp(LEAST)[:, None] * (before + share * way - here)
        homeward = self._follow(row, back[None])
        return Passed(*(np.concatenate(pair, 1)[0] for pair in zip(onward, homeward, strict=True)))

    def _follow(self, rows: NDArray[np.intp], control: Array) -> Passed:
        """Steps `rows` under control (n, k, nu)."""
        recorded = self._batch.rollout(control.shape[1], control, record=("sensordata", "qpos"), ids=rows)
        touch = recorded["sensordata"][:, :, self._touch : self._touch + 4]
        forces = np.sqrt(np.square(touch[..., 1:]).sum(-1))
        return Passed(forces, touch[..., 0], recorded["qpos"][:, :, self._joints])

    def _substeps(self, rows: NDArray[np.intp], joints: Array, way: Array) -> NDArray[np.int64]:
        """How many a ramp takes (n,)."""
        there, here = self._robot.gripper_position(np.stack([joints + way, joints]), self._lengths[rows])
        apart = np.sqrt(np.square(there - here).sum(-1))
        seconds = PEAK * np.maximum(apart / SPEED, (np.abs(way) / self._speeds).max(-1))
        return np.maximum(np.ceil(seconds / self._model.opt.timestep), LEAST).astype(np.int64)

    def is_collision_free(self, row: int, joints: Array) -> bool:
        """Whether the arm of a row touches nothing, nearly, with joints at (j,)."""
        model, data = self.show(row, self._picture, joints)
        mujoco.mj_collision(model, data)
        return not self._of_arm[data.contact.geom].any()

    def way_is_free(self, row: int, joints: Array, there: Array) -> bool:
        """Whether the arm of a row touches nothing on the straight way between joints (j,) and others."""
        shares = np.linspace(1, 0, ON_THE_WAY)
        return all(self.is_collision_free(row, joints + share * (there - joints)) for share in shares)


def ramp(substeps: int, settling: int = SETTLING) -> Array:
    """Shares of a way (k,) after each substep: with least jerk in so many of them, then at rest."""
    return smooth(np.minimum(np.arange(1.0, substeps + settling + 1) / substeps, 1.0))
