"""The ceiling of docking: arcs that are planned by the truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.observation import Array
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from .observation import DockObservation
from .planner import Planner
from .projective_model import ProjectiveModel

SCALE = 4.0
"""Image units in a metre, as seen from above. Choice: what is near enough in images is then 2 mm."""
DOCKED = SCALE * np.array([[0.5, 0.0], [-0.5, 0.0]])
"""Two points of the floor (2, 2) as a robot sees them from above that has docked."""
EVERYWHERE = np.full(DOCKED.shape, np.inf)
"""None of them can be lost."""
GRID = np.linspace(-1, 1, 2001)
"""Words at which motors' curves are inverted."""


@agent("oracle", "Is told where it stands, and what its wheels do: the ceiling.", tasks=("dock",))
class DockingOracle(ProcedureAgent):
    """Plans arcs as `Arcs` does, but by the truth, as if it saw the floor from above.

    What is left are wheels that slip and the few arcs that docking takes.
    """

    privileged = ("pose", "wheels")
    needs_points = False

    @property
    def kind(self) -> str:
        return "DockingOracle()"

    def observed(self, raw: Any) -> DockObservation:
        return DockObservation.of(raw)

    def procedure(self, first: Any, findings: None) -> Procedure:
        """See `ProcedureAgent`."""
        now, rest = first, None
        planner = Planner(EVERYWHERE, np.random.default_rng(self.seed))
        while True:
            model, curvature = from_above(now.privileged["wheels"])
            plan = planner.plan(model, seen_from(now.privileged["pose"]), DOCKED, rest)
            curves = GRID + curvature[:, None] * GRID * (GRID**2 - 1)
            words = [np.interp(word, curve, GRID) for word, curve in zip(plan.words[0], curves, strict=True)]
            now, rest = (yield np.array(words)), plan.words[1:]


def from_above(wheels: Array) -> tuple[ProjectiveModel, Array]:
    """What words do to points of the floor as a robot sees them from above, but for motors' curves.

    Args:
        wheels: As `tell=("wheels",)` tells them (4 m,).

    Returns:
        A model without curvatures, and those curvatures (m,).
    """
    motors = len(wheels) // 4
    model = ProjectiveModel(len(DOCKED), motors)
    model.learned.nearness[...] = 1
    model.learned.twists[0, :motors] = wheels[: 3 * motors].reshape(motors, 3) * [-SCALE, -SCALE, -1]
    return model, wheels[3 * motors :]


def seen_from(pose: Array) -> Array:
    """The points `DOCKED` (2, 2) as a robot at a pose (3,) before the dock sees them from above."""
    x, y, heading = pose
    c, s = np.cos(heading), np.sin(heading)
    return (DOCKED - [SCALE * x, SCALE * y]) @ np.array([[c, -s], [s, c]])
