"""N arms that put a peg into a hole. Both environments step them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.contact_arms import ContactArms
from calfree_gym.envs.arms.sight import Seen
from calfree_gym.envs.arms.state import RowState
from calfree_gym.geometry import Array, Rows
from calfree_gym.image import IMAGE_SIZE, PIXELS_PER_UNIT, lengths
from calfree_gym.robot.inserting.holes import Holes
from calfree_gym.robot.inserting.inserting_arm import InsertingArm
from calfree_gym.robot.inserting.peg import RADIUS
from calfree_gym.robot.inserting.simulation import OBJECT, InsertSimulation
from calfree_gym.world import World

TIP, BASE, HOLE = ((2 * place, 2 * place + 1) for place in (0, 1, OBJECT))
"""Where the points of the peg's end, the gripper's base and the hole stand among the image points."""


class InsertingArms(ContactArms):
    """N arms, whose cameras see `robot.inserting.simulation.POINTS`.

    Attributes:
        forces: Of the gripper and the peg on table and plate (N, 2) in the last motion, in N: the largest.
        largest: Of the plate's, the largest in this trial (N,).
        poses: Of the plates (N, 7): the hole's centre in m, and a quaternion.

    Args:
        rows: N.
        clearance: The hole's diameter less the peg's (m).
        threads: Threads of the simulation; they change no number.
        camera_mount, keep_in_view, observation, **shared: See `ContactArms`.

    Raises:
        ValueError: See `Arms`.
    """

    shown_points: ClassVar[tuple[int, int, int, int]] = (*TIP, *HOLE)
    simulation: InsertSimulation
    state_names: ClassVar[tuple[str, ...]] = (*ContactArms.state_names, "forces", "largest", "poses")

    def __init__(
        self,
        rows: int,
        *,
        camera_mount: str | tuple[str, ...],
        keep_in_view: bool,
        clearance: float,
        threads: int,
        observation: str = "points",
        **shared: Any,
    ) -> None:
        robot = InsertingArm(clearance)
        super().__init__(
            InsertSimulation(rows, robot, robot.mounts(camera_mount), threads),
            robot,
            camera_mount=camera_mount,
            keep_in_view=keep_in_view,
            observation=observation,
            image_size=IMAGE_SIZE,
            **shared,
        )
        self._holes = Holes(robot, self._workspaces, self.motors, keep_in_view)
        self.forces, self.largest, self.poses = np.zeros((rows, 2)), np.zeros(rows), np.zeros((rows, 7))
        self.delivered: Seen = (self.points, self.visible)

    def serves(self, row: int, world: World) -> bool:
        """See `ContactArms`: there is a place for holes."""
        return self._holes.serves(row, world)

    def can_begin(self, row: int) -> Callable[[World], bool]:
        """See `Arms`: there is a place for holes."""
        return self.also_in_view(row)

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: poses of plates (n, 7); given are holes' centres (n, 3)."""
        for i, row in enumerate(rows.tolist()):
            which = row, self._seeds[row] or 0, int(self.trials[row]), self.world(row)
            self.poses[row] = (
                self._holes.draw(*which) if given is None else self._holes.given(*which, given[i])
            )
        return self.poses[rows]

    def begun(self, rows: Rows) -> None:
        """See `Arms`."""
        self.forces[rows], self.largest[rows] = 0.0, 0.0
        super().begun(rows)

    def execute(self, rows: Rows, words: Array) -> Array:
        """See `Arms`: the jaws stay closed on the peg."""
        seconds, motion = self.travelled(rows, words, np.full(len(self._all[rows]), RADIUS))
        self.forces[rows] = motion.forces
        self.largest[rows] = np.maximum(self.largest[rows], motion.forces[:, 1])
        return seconds

    def observe(self) -> None:
        """See `Arms`."""
        self.look()
        self.delivered = self._latency.deliver(self.motions_of_trial, self.points, self.visible)

    def set_state(self, row: int, state: RowState) -> None:
        """See `Arms`."""
        super().set_state(row, state)
        self.simulation.set_plate(row, self.poses[row])

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels of pegs' ends from holes' centres."""
        away = self.true_points[:, TIP] - self.true_points[:, HOLE]
        return np.asarray(PIXELS_PER_UNIT * lengths(away).max(1))
