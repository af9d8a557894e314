"""Arms that put a peg into a hole: the physics of arms that grasp, and a plate that does not move."""

from __future__ import annotations

from typing import ClassVar

import mujoco
import numpy as np

from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.grasping.simulation import OBJECT, GraspSimulation
from calfree_gym.robot.grasping.simulation import POINTS as OF_GRASPING
from calfree_gym.robot.inserting.peg import RIMS
from calfree_gym.robot.simulation import Picture

POINTS = (*OF_GRASPING[: OBJECT + 1], *RIMS)
"""What cameras see: of the gripper as in grasping, with the peg's end as its point; the hole's centre, on the
upper side of the plate; and four points of the plate around it."""


class InsertSimulation(GraspSimulation):
    """N arms that put pegs into holes."""

    seen: ClassVar[tuple[str, ...]] = POINTS
    told: ClassVar[slice] = slice(2, 4)
    """See `GraspSimulation`: all contacts together, for a peg that presses has many."""
    pinned: ClassVar[float] = 0.0
    """See `GraspSimulation`: nothing pins a peg, and who presses is to press no more."""

    def _bind_object(self, model: mujoco.MjModel) -> tuple[str, ...]:
        return ("body_quat",)

    def _put(self, rows: Rows, objects: Array) -> None:
        """Puts plates at their poses (n, 7): the hole's centre in m, and a quaternion."""
        self._body_position[rows, self._body] = objects[:, :3]
        self._fields["body_quat"][rows, self._body] = objects[:, 3:]

    def set_plate(self, row: int, pose: Array) -> None:
        """Puts the plate of a row at a pose (7,), with the arm where it is."""
        self._put(np.array([row]), pose[None])

    def tips(self) -> tuple[Array, Array]:
        """How deep the pegs' ends are below the plates' upper side (N,), and how far from holes' axes (N,).

        In m, at the last refresh.
        """
        tip, hole = self.positions()
        across = self._sites[:, self._site[OBJECT + 1 :]] - hole[:, None]
        normal = np.cross(across[:, 0], across[:, 2])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        depth = -np.einsum("nk,nk->n", tip - hole, normal)
        return depth, np.linalg.norm(tip - hole + depth[:, None] * normal, axis=-1)

    def show_object(self, row: int, picture: Picture, object_: Array | None) -> None:
        """See `Simulation`: the plate stays where it is."""
        picture[0].body_quat[:] = self._fields["body_quat"][row]
