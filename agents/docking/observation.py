"""What a controller observes that docks: the dock's marks and its own, in all cameras, and an odometer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calfree_gym.image import lengths_px

from ..base.observation import STANDARD_KEYS, Array, Flags, RawObservation, privileged_in


@dataclass(frozen=True)
class DockObservation:
    """Image points, flags and sums of words after one motion.

    Attributes:
        points: Image points of the dock's marks (p, 2), p of them in all cameras, in image units.
        goal: Of the robot's own marks (p, 2), where the dock's are to be seen.
        visible: Which of the dock's are seen now (p,).
        shown: Which of its own are seen now (p,).
        registers: Sums of control words since the trial began (m,): no place hangs on them alone.
        privileged: What was asked for by `tell=`, by name.
        last: Whether the trial is known to be over with it.
    """

    points: Array
    goal: Array
    visible: Flags
    shown: Flags
    registers: Array
    privileged: Mapping[str, Array] = field(default_factory=dict)
    last: bool = False

    @classmethod
    def of(cls, raw: RawObservation) -> DockObservation:
        """Reads one environment's observation."""
        state = np.asarray(raw["observation"], float)
        points, goal = (np.asarray(raw[key], float).reshape(-1, 2) for key in STANDARD_KEYS[:2])
        count = len(points)
        return cls(
            points=points,
            goal=goal,
            visible=state[:count] > 0.5,
            shown=state[count : 2 * count] > 0.5,
            registers=state[2 * count :],
            privileged=privileged_in(raw),
        )

    @property
    def object(self) -> Array:
        """The dock's image points (2p,), a view."""
        return self.points.reshape(-1)

    @property
    def distance(self) -> Array:
        """The image distance (2p,): the dock's points minus its own."""
        return (self.points - self.goal).reshape(-1)

    @property
    def distance_px(self) -> float:
        """The longest of the p distances, in pixels."""
        return float(lengths_px(self.points - self.goal).max())
