"""Whether cameras see a gripper that grasps and a thing on the table, or something stands before them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import CAMERAS
from calfree_gym.robot.line_of_sight import NOWHERE, shares_by_camera

if TYPE_CHECKING:
    from calfree_gym.robot.grasping.shapes import Thing
    from calfree_gym.robot.simulation import Simulation

JAWS, EDGES = ("jaw_1_tip", "jaw_2_tip"), ("edge_1", "edge_2")
OF_A_JAW, OF_AN_EDGE = 0.016, 0.010
"""Radii of balls that stand for what marks them (m)."""
TOWARD_ENDS = 0.8
"""So far out on its axis a thing is seen at either end, too. Choice."""
LEAST_SHARE = 0.5
"""Of a jaw or an edge that must be in sight. Choice: its colour is then found."""


class InSight:
    """What the cameras of N worlds see past the arm.

    Args:
        simulation: The N worlds.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._picture = simulation.picture()
        model = self._picture[0]
        self._cameras = [model.camera(simulation.prefix + name).id for name in CAMERAS]
        self._jaws, self._edges = ([model.site(name).id for name in names] for names in (JAWS, EDGES))

    def gripper(self, row: int, joints: Array) -> bool:
        """Whether both cameras see both jaws, and an edge, with joints at (j,)."""
        _, data = self._simulation.show(row, self._picture, joints, NOWHERE)
        jaws = self._shares(data.site_xpos[self._jaws], OF_A_JAW)
        edges = self._shares(data.site_xpos[self._edges], OF_AN_EDGE)
        return bool(jaws.min() >= LEAST_SHARE and edges.max(1).min() >= LEAST_SHARE)

    def thing(self, row: int, thing: Thing, pose: Array, joints: Array) -> float:
        """The least share of a thing at a pose (4,) that a camera sees, with joints at (j,)."""
        self._simulation.show(row, self._picture, joints, NOWHERE)
        c, s = np.cos(pose[3]), np.sin(pose[3])
        x, y, z = TOWARD_ENDS * thing.axis
        ahead = np.array([c * x - s * y, s * x + c * y, z])
        return float(self._shares(pose[:3] + np.outer([0, 1, -1], ahead), thing.width / 4).min())

    def _shares(self, balls: Array, radius: float) -> Array:
        """Which share (2, k) of balls (k, 3) each camera sees."""
        return shares_by_camera(self._picture, self._cameras, balls, radius)
