"""N arms that touch things: what grasping and inserting share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

from calfree_gym.engine.arms import Arms
from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.grasping.gripping_arm import GrippingArm
from calfree_gym.robot.grasping.simulation import GraspSimulation, Motion
from calfree_gym.vision.tracking.grasp_tracker import GraspTracker
from calfree_gym.world import World


class ContactArms(Arms):
    """N arms whose gripper touches things, and whose cameras see what their simulation says. See `Arms`."""

    may_stop_short: ClassVar[bool] = True
    also_asks = "can the task be done in enough places"
    simulation: GraspSimulation
    robot: GrippingArm

    def new_tracker(self) -> GraspTracker:
        return GraspTracker()

    def also_in_view(self, row: int) -> Callable[[World], bool]:
        """See `Arms`: the task can be done in enough places."""

        def serves(world: World) -> bool:
            self._workspaces.set_world(row, world)
            self.simulation.set_world(row, world)
            return self.serves(row, world)

        return serves

    def can_begin(self, row: int) -> Callable[[World], bool]:
        """See `Arms`: the task can be done in enough places."""
        return self.also_in_view(row)

    @abstractmethod
    def serves(self, row: int, world: World) -> bool:
        """Whether the task can be done in enough places of a world, into which the row is put."""

    def travelled(self, rows: Rows, joints: Array, openings: Array) -> tuple[Array, Motion]:
        """Sends arms to joint positions (n, j), the jaws going to openings (n,) in m.

        Where the guard stops an arm, its registers are those of where it stands.

        Returns:
            How long the arms travel (n,), in seconds, and what became of the motions.
        """
        indices, simulation = self._all[rows], self.simulation
        seconds = simulation.travel(rows, joints)
        motion = simulation.move(indices, joints, openings)
        simulation.recover()
        for i in (motion.shares < 1).nonzero()[0].tolist():
            self.stopped_short(int(indices[i]), motion.shares[i])
        return seconds, motion
