"""Arms that reach where things stand in the way: smooth motions, contacts, and a drive that trips."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.grasping.ramp import smooth
from calfree_gym.robot.grasping.simulation import PEAK
from calfree_gym.robot.reach_simulation import ReachSimulation
from calfree_gym.robot.touching.furniture import CLEARANCE, SENSOR, furniture, keep_apart, of_arm, of_room

if TYPE_CHECKING:
    from calfree_gym.world import World

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
        super().__init__(rows, robot, mounts, "physics", threads, furniture(robot))
        self._lengths = np.tile(robot.lengths, (rows, 1))
        self._touch = int(self._model.sensor(SENSOR).adr[0])
        self._joints = np.atleast_1d(np.arange(self._model.nq)[self._qpos])
        self._touched = np.zeros((rows, len(Touched._fields)))
        self._picture = self.picture()
        model = self._picture[0]
        self._of_arm = of_arm(model, robot)
        keep_apart(model, of_room(model), CLEARANCE * robot.rig.scale)

    def set_world(self, row: int, world: World) -> None:
        """See `Simulation`."""
        super().set_world(row, world)
        self._lengths[row] = world.link_lengths

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

    def is_free(self, row: int, joints: Array) -> bool:
        """Whether the arm of a row touches nothing, nearly, with joints at (j,)."""
        model, data = self.show(row, self._picture, joints)
        mujoco.mj_collision(model, data)
        return not self._of_arm[data.contact.geom].any()

    def way_is_free(self, row: int, joints: Array, there: Array) -> bool:
        """Whether the arm of a row touches nothing on the straight way between joints (j,) and others."""
        shares = np.linspace(1, 0, ON_THE_WAY)
        return all(self.is_free(row, joints + share * (there - joints)) for share in shares)


def ramp(substeps: int) -> Array:
    """Shares of a way (k,) after each substep: with least jerk in so many of them, then at rest."""
    return smooth(np.minimum(np.arange(1.0, substeps + SETTLING + 1) / substeps, 1.0))
