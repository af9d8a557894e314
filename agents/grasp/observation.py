"""What a controller observes that grasps: points of gripper and object, jaws, and where to lift to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..base.observation import Array, Flags, Observation, RawObservation

NAMES = ("tip", "base", "jaw_1", "jaw_2", "edge_1", "edge_2", "object", "end_1", "end_2")
"""What is seen, in the order of the flags."""
OBJECT = NAMES.index("object")
FLAGS = 2 * len(NAMES)
GOAL = 5
"""Numbers of a goal: the object's sensor vector, and whether it is held."""
ARM = 3
"""So many motors bring the gripper to a place; the next one turns it, and the last one closes its jaws."""


@dataclass(frozen=True)
class GraspObservation:
    """Image points, flags, registers and jaws after one motion.

    Attributes:
        points: Image points (9, 2, 2) in image units: of each of `NAMES`, left and right.
        visible: Which of them are seen now (9, 2).
        registers: Executed sums of control words since home (5,).
        opening: How far the jaws are open, from 0 to 1.
        held: Whether the object is held.
        goal: Where the object is to be lifted to (2, 2), left and right.
        last: Whether the trial is known to be over with it.
    """

    points: Array
    visible: Flags
    registers: Array
    opening: float
    held: bool
    goal: Array
    privileged: Mapping[str, Array] = field(default_factory=dict)
    last: bool = False

    @classmethod
    def of(cls, raw: RawObservation) -> GraspObservation:
        """Reads one environment's observation."""
        state = np.asarray(raw["observation"], float)
        achieved, desired = (np.asarray(raw[key], float) for key in ("achieved_goal", "desired_goal"))
        others = state[FLAGS + ARM + 3 :].reshape(len(NAMES) - 1, 2, 2)
        return cls(
            points=np.insert(others, OBJECT, achieved[:4].reshape(2, 2), axis=0),
            visible=state[:FLAGS].reshape(len(NAMES), 2) > 0.5,
            registers=state[FLAGS : FLAGS + ARM + 2],
            opening=float(state[FLAGS + ARM + 2]),
            held=bool(achieved[4] > 0.5),
            goal=desired[:4].reshape(2, 2),
        )

    @property
    def object(self) -> Array:
        """The object's sensor vector (4,)."""
        return self.at("object").reshape(4)

    def at(self, name: str) -> Array:
        """Image points (2, 2) of one of `NAMES`, left and right."""
        return self.points[NAMES.index(name)]

    def between(self, start: str, end: str) -> Array:
        """The way in both images (4,) from one of `NAMES` to another."""
        return (self.at(end) - self.at(start)).reshape(4)

    def toward(self, target: Array, seen: Flags) -> Observation:
        """The same as who reaches sees it: the gripper's tip, and a target (2, 2) in place of the object.

        Args:
            target: Where the tip should be, left and right.
            seen: Whether (2,) that is known from what is seen now.
        """
        visible = np.concatenate([self.visible[0], seen])
        points = np.concatenate([self.at("tip"), target])
        return Observation(points, visible, self.registers[:ARM], last=self.last)
