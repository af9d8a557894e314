"""What a controller observes that grasps: points of gripper and object, jaws, and where to lift to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from ..base.observation import STANDARD_KEYS, Array, Flags, Observation, RawObservation

NAMES = ("tip", "base", "jaw_1", "jaw_2", "edge_1", "edge_2", "object", "end_1", "end_2")
"""What is seen, in the order of the flags."""
TIP, BASE, OBJECT = (NAMES.index(name) for name in ("tip", "base", "object"))
OF_GRIPPER = slice(OBJECT)
FLAGS = 2 * len(NAMES)
OTHERS = 4 * (len(NAMES) - 1)
"""Numbers of the image points of all but the object."""
GOAL = 5
"""Numbers of a goal: the object's sensor vector, and whether it is held."""
SLANTED = 3.0
"""A gripper is seen from one side where its edge and the line of its jaws span an area so slim (the ratio of
its axes): one image then tells no angle. Choice."""
ARM = 3
"""So many motors at least bring the gripper to a place; the last but one turns it, the last one closes its
jaws."""


@dataclass(frozen=True)
class GraspObservation:
    """Image points, flags, registers and jaws after one motion.

    Attributes:
        points: Image points (9, 2, 2) in image units: of each of `NAMES`, left and right.
        visible: Which of them are seen now (9, 2).
        registers: Executed sums of control words since home (5,); with a word that tilts the wrist (6,).
        opening: How far the jaws are open, from 0 to 1.
        held: Whether the object is held.
        goal: Where the object is to be lifted to (2, 2), left and right.
        last: Whether the trial is known to be over with it.
        proportions: Of the gripper (3,): how long its edge, the line of its jaws, here open, and its axis
            are, in gripper lengths; roughly, for near zero they do not matter.
    """

    proportions: ClassVar[Array] = np.array([1.0, 1.1, 1.0])
    points: Array
    visible: Flags
    registers: Array
    opening: float
    held: bool
    goal: Array
    last: bool = False

    @classmethod
    def of(cls, raw: RawObservation) -> GraspObservation:
        """Reads one environment's observation."""
        state = np.asarray(raw["observation"], float)
        achieved, desired = (np.asarray(raw[key], float) for key in ("achieved_goal", "desired_goal"))
        others = state[-OTHERS:].reshape(len(NAMES) - 1, 2, 2)
        return cls(
            points=np.insert(others, OBJECT, achieved[:4].reshape(2, 2), axis=0),
            visible=state[:FLAGS].reshape(len(NAMES), 2) > 0.5,
            registers=state[FLAGS : -OTHERS - 1],
            opening=float(state[-OTHERS - 1]),
            held=bool(achieved[4] > 0.5),
            goal=desired[:4].reshape(2, 2),
        )

    @property
    def turning(self) -> int:
        """Place of the motor that turns the gripper, among the registers: after the arm's."""
        return len(self.registers) - 2

    @property
    def arm(self) -> Array:
        """Registers of the motors that bring the gripper to a place (3,) or (4,)."""
        return self.registers[: self.turning]

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

    def in_gripper_lengths(self, way: Array) -> Array | None:
        """A way that is seen in both images (4,), in the world (3,), as far as both images tell.

        It is made up of three directions that are seen on the gripper: its edge, the line of its jaws, and
        its axis. So neither the cameras nor perspective matter near the gripper. Where one image shows all of
        these, the way is taken to lie across the axis; where none does, nothing is told: None.
        """
        told = self.visible[OF_GRIPPER].all(0)
        directions = [("edge_2", "edge_1"), ("jaw_2", "jaw_1"), ("tip", "base")]
        seen = np.stack([self.between(*ends) for ends in directions], 1)[told.repeat(2)]
        seen[:, 2] *= told.all()
        if not told.all() and (not told.any() or np.linalg.cond(seen[:, :2]) > SLANTED):
            return None
        return self.proportions * np.linalg.lstsq(seen, way[told.repeat(2)], rcond=None)[0]

    def length(self, way: Array) -> float:
        """How long such a way is, in gripper lengths: of the gripper's axis in images, if it sees no more."""
        lengths = self.in_gripper_lengths(way) if self.visible[OF_GRIPPER].all() else None
        if lengths is not None:
            return float(np.linalg.norm(lengths))
        return float(np.linalg.norm(way) / np.linalg.norm(self.between("tip", "base")))

    def with_hidden_tip(self, hangs: Array) -> GraspObservation:
        """The same, where a tip that is hidden is told by the object, which hangs so far from it (2, 2)."""
        hidden = ~self.visible[TIP] & self.visible[OBJECT]
        points, visible = self.points.copy(), self.visible.copy()
        points[TIP, hidden], visible[TIP, hidden] = (points[OBJECT] - hangs)[hidden], True
        return replace(self, points=points, visible=visible)

    def toward(self, target: Array, seen: Flags) -> Observation:
        """The same as who reaches sees it: the gripper's tip, and a target (2, 2) in place of the object.

        Args:
            target: Where the tip should be, left and right.
            seen: Whether (2,) that is known from what is seen now.
        """
        visible = np.concatenate([self.visible[TIP], seen])
        points = np.concatenate([self.at("tip"), target])
        return Observation(points, visible, self.arm, last=self.last)


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


REACHED = 4
"""Numbers of a goal of reaching: the gripper's sensor vector."""


def task_of(env: gym.Env[Any, Any]) -> str:
    """The task of an environment: what it says, or where wrappers change what it observes, by its spaces.

    Goals of grasping also tell whether the object is held, those of inserting how deep the peg is; who
    inserts has no word for jaws. Those of docking are image points of several marks.

    Raises:
        ValueError: It is no environment, none of ours, or its observation has no image points.
    """
    space = getattr(env, "observation_space", None)
    if space is None:
        raise ValueError(
            f"it needs an environment, such as gymnasium.make('CalFree/Reach-v0'); found {env!r}"
        )
    spaces = getattr(space, "spaces", None)
    if not isinstance(spaces, Mapping) or "observation" not in spaces:
        raise ValueError(
            f"it needs an environment of calfree_gym; or one with its spaces: this one's observation is "
            f"{space}"
        )
    if missing := [key for key in STANDARD_KEYS if key not in spaces]:
        raise ValueError(
            f"it needs image points ({', '.join(missing)}); this environment's observation has only "
            f"{', '.join(spaces)}; make it with observation='points' or 'vision'"
        )
    made = getattr(env, "unwrapped", env)
    if made.observation_space is space and isinstance(task := getattr(made, "task", None), str):
        return task
    goals = spaces["achieved_goal"].shape
    numbers = goals[-1] if goals else 0
    if numbers != GOAL and (numbers % 2 or not numbers):
        raise ValueError(
            f"it needs an environment of calfree_gym, or one with its spaces, where achieved_goal has two of "
            f"each of a dock's marks, or {REACHED} or {GOAL} numbers; this environment's has shape {goals}"
        )
    if numbers == REACHED:
        return "reach"
    if numbers != GOAL:
        return "dock"
    return "insert" if env.action_space.shape[-1] == INSERT_WORDS else "grasp"  # type: ignore[index]
