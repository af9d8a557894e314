"""What a controller observes that inserts: points of gripper, peg and plate."""

from __future__ import annotations

import numpy as np

from ...base.observation import RawObservation
from ..observation import ARM, OBJECT, GraspObservation

RIMS = 4
"""Points of the plate around the hole."""
POINTS = OBJECT + 1 + RIMS
INSERT_FLAGS = 2 * POINTS
INSERT_WORDS = ARM + 1
"""Of the arm, and of the wrist's turn; the jaws have none."""


class InsertObservation(GraspObservation):
    """As when grasping: the peg's end is the tip, the hole is the object.

    The jaws hold nothing that is to be lifted. The plate's points lie evenly around the hole. So the hole is
    seen less noisily: as the mean of its own point and of these, where an image shows all of them.
    """

    proportions = np.array([1.0, 0.36, 1.0])
    """See `GraspObservation`: the jaws are closed on the peg."""

    @property
    def turning(self) -> int:
        """See `GraspObservation`: the jaws have no word."""
        return ARM

    @classmethod
    def of(cls, raw: RawObservation) -> InsertObservation:
        """Reads one environment's observation."""
        state = np.asarray(raw["observation"], float)
        achieved, desired = (np.asarray(raw[key], float) for key in ("achieved_goal", "desired_goal"))
        others = state[INSERT_FLAGS + INSERT_WORDS :].reshape(POINTS - 2, 2, 2)
        tip, hole = achieved[:4].reshape(1, 2, 2), desired[:4].reshape(1, 2, 2)
        points = np.concatenate([tip, others[: OBJECT - 1], hole, others[OBJECT - 1 :]])
        visible = state[:INSERT_FLAGS].reshape(POINTS, 2) > 0.5
        whole = visible[OBJECT:].all(0)
        points[OBJECT, whole] = points[OBJECT:, whole].mean(0)
        return cls(
            points=points,
            visible=visible,
            registers=state[INSERT_FLAGS : INSERT_FLAGS + INSERT_WORDS],
            opening=1.0,
            held=False,
            goal=np.zeros((2, 2)),
        )
