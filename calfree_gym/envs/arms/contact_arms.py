"""N arms that touch things: what grasping and inserting share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.base import Arms
from calfree_gym.envs.arms.sight import sight_of
from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.image import IMAGE_UNIT, inside
from calfree_gym.robot.grasping.gripping_arm import GrippingArm
from calfree_gym.robot.grasping.simulation import GraspSimulation, Motion
from calfree_gym.vision.tracking.grasp_tracker import GraspTracker
from calfree_gym.world import World


class ContactArms(Arms):
    """N arms whose gripper touches things, and whose cameras see what their simulation says.

    Args:
        simulation, robot, camera_mount, keep_in_view, **shared: See `Arms`.
        tolerance_px: Image distance within which the task is done.
        observation: "points", or what is rendered: "vision" or "pixels".
        image_size: Width and height in pixels of images that are delivered.

    Raises:
        ValueError: See `Arms`.
    """

    simulation: GraspSimulation
    robot: GrippingArm
    may_stop_short: ClassVar[bool] = True
    parts: ClassVar[tuple[str, ...]] = (*Arms.parts, "_sight")
    also_asks = "can the task be done in enough places"

    def __init__(
        self,
        simulation: GraspSimulation,
        robot: GrippingArm,
        *,
        camera_mount: str | tuple[str, ...],
        tolerance_px: float,
        observation: str,
        image_size: int,
        **shared: Any,
    ) -> None:
        points = 2 * len(simulation.seen)
        super().__init__(simulation, robot, points, camera_mount=camera_mount, **shared)
        self.tolerance = np.float32(tolerance_px * IMAGE_UNIT)
        self._sight = sight_of(self, observation, image_size, GraspTracker)
        self._moved = np.zeros(self.rows, bool)

    def seed_streams(self, row: int, seed: int) -> None:
        """See `Arms`."""
        super().seed_streams(row, seed)
        self._sight.seed(row, seed)

    def enter(self, row: int, world: World) -> None:
        """See `Arms`."""
        super().enter(row, world)
        self._sight.set_world(row, world)
        self._moved[row] = True

    def also_in_view(self, row: int) -> Callable[[World], bool]:
        """See `Arms`: the task can be done in enough places."""

        def serves(world: World) -> bool:
            self.motors.set_world(row, world)
            self._workspaces.set_world(row, world)
            self.simulation.set_world(row, world)
            return self.serves(row, world)

        return serves

    @abstractmethod
    def serves(self, row: int, world: World) -> bool:
        """Whether the task can be done in enough places of a world, into which the row is put."""

    def begun(self, rows: Rows) -> None:
        """See `Arms`."""
        self._sight.begin_trial(self._all[rows])
        self._moved[rows] = True

    def travelled(self, rows: Rows, words: Array, openings: Array) -> tuple[Array, Motion]:
        """Executes words (n, m) of the arms, the jaws going to openings (n,) in m.

        Where the guard stops an arm, its registers are those of where it stands.

        Returns:
            How long the arms travel (n,), in seconds, and what became of the motions.
        """
        indices, simulation = self._all[rows], self.simulation
        self._moved[rows] = True
        joints = self.targets(rows, words)
        seconds = simulation.travel(rows, joints)
        motion = simulation.move(indices, joints, openings)
        simulation.recover()
        for i in (motion.shares < 1).nonzero()[0].tolist():
            self.stopped_short(int(indices[i]), motion.shares[i])
        return seconds, motion

    def look(self) -> tuple[Array, Flags, tuple[NDArray[Any], ...]]:
        """Takes in what the cameras see.

        Returns:
            The way of all points (N, p, 2) since the last look, which of them (N, p) both looks saw, and
            images, where they are delivered.
        """
        self.simulation.refresh()
        pixels, depth = self.simulation.pinhole_pixels()
        true, shown = self._workspaces.cameras.through_lens(pixels)
        visible = shown & (depth > 0) & inside(true)
        self.true_points = true
        seen, now_visible, *images = self._sight.look(true, visible, self._moved)
        self._moved[:] = False
        before, both = self.points, self.visible & now_visible
        self.visible = now_visible
        self.points = np.where(now_visible[:, :, None], seen, before)
        return self.points - before, both, tuple(images)

    def close(self) -> None:
        """See `Arms`."""
        self._sight.close()
