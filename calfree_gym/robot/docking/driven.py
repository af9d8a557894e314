"""N bases in full physics: their servos follow least jerk, and the floor does the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from mujoco.batch import Batch

from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.docking.base import WHEEL_RADIUS, Base
from calfree_gym.robot.docking.model import at_poses, model_of, pose_of
from calfree_gym.robot.docking.simulation import RollingSimulation
from calfree_gym.robot.simulation import keep_in_copies
from calfree_gym.robot.touching import ramp

if TYPE_CHECKING:
    from calfree_gym.world.value import World

RAMP, SETTLING = 1000, 150
"""Physics substeps of 2 ms, in which the wheels are driven, and then stand. Choice: at 2 m a motion they do
not slip yet, and at its end they are at rest to 0.1 mm."""
_BEFORE = 500
"""Substeps in which the base comes to rest on its wheels, once (a guard)."""


class DrivenSimulation(RollingSimulation):
    """N bases that MuJoCo drives, one row each.

    Args:
        rows: N.
        base: The base.
        threads: Threads that step the rows; they change no number.
    """

    state_names: ClassVar[tuple[str, ...]] = (*RollingSimulation.state_names, "_physics")
    of_world: ClassVar[tuple[str, ...]] = (*RollingSimulation.of_world, "_body_position")

    def __init__(self, rows: int, base: Base, threads: int) -> None:
        super().__init__(rows, base)
        model = model_of(base)
        self._batch = Batch(model, rows, nthread=threads)
        keep_in_copies(self._batch)
        self._physics = self._batch.state
        self._body_position = self._batch.expand("body_pos")
        self._wheels = [model.body(name).id for name in base.wheels]
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._ctrl, self._warm = self._batch.bind("ctrl"), self._batch.bind("qacc_warmstart")
        self._batch.step(None, _BEFORE)
        self._height = float(self._qpos[0, 2])
        self._shares = ramp(RAMP, SETTLING)[:, None]

    def set_world(self, row: int, world: World) -> None:
        """See `RollingSimulation`."""
        super().set_world(row, world)
        self._body_position[row, self._wheels, :2] = self._base.stand * (world.link_lengths[0] / 2)

    def place(self, rows: Rows, joints: Array, objects: Array) -> None:
        """See `RollingSimulation`."""
        super().place(rows, joints, objects)
        self._qpos[rows] = at_poses(self.poses[rows], self._height, self._qpos.shape[1])
        self._qvel[rows] = self._ctrl[rows] = self._warm[rows] = 0.0

    def _drive(self, rows: Rows, ways: Array) -> None:
        """See `RollingSimulation`."""
        before = self._ctrl[rows][:, None]
        control = before + self._shares * (ways / WHEEL_RADIUS)[:, None]
        ids = None if isinstance(rows, slice) else rows
        self._batch.rollout(len(self._shares), control, record=(), ids=ids)
        there = pose_of(self._qpos[rows])
        turned = there[:, 2] - self.poses[rows, 2]
        turned -= 2 * np.pi * np.round(turned / (2 * np.pi))
        there[:, 2] = self.poses[rows, 2] + turned
        self.poses[rows] = there

    def configuration(self, row: int) -> Array:
        """See `RollingSimulation`."""
        return self._qpos[row].copy()
