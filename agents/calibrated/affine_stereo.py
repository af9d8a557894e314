"""Affine stereo: image coordinates as an affine function of position (Hollinghurst & Cipolla 1994)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from calfree_gym.world import nominal

from ..base.checks import check_number
from ..base.observation import POINTS, Array, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from ..servo.jacobian import distance_jacobian, linear_deviations_px
from ..servo.perception import ObservationFilter, Observing
from ..servo.trial import half_way_back
from .robot_model import RobotModel


@agent(
    "affine_stereo",
    "Calibrates itself at four known positions (Hollinghurst, Cipolla 1994).",
    arms="movemaster",
)
class AffineStereo(ProcedureAgent):
    """Self-calibrates at four known positions, then goes to the object in proportional steps.

    From the reference: far from the cameras the four image coordinates are an affine function of position,
    whose 16 parameters four known positions, not in one plane, give exactly; steps in three dimensions with a
    gain below 1 make up for what is not affine. Its observations have a privileged key, the gripper's
    position in the room; it uses this at these four only: at home and after three motions, in every trial.

    Reconstructions: the affine function is that of the image distance d, so that it also holds where cameras
    turn with the waist and move the object in the images; and positions become words by the arm as built,
    whose linear errors the same four positions correct: "linear modeling errors of the manipulator" (paper,
    section 2.3). An arm whose motors turn the other way, or twice as far, is no linear error: in wild worlds
    a quarter to a third of the trials fail.

    Beside the privileged positions it knows the arm as built, with the simulator's own kinematics and motor
    curve; of the cameras nothing.

    Args:
        gain: Share of the way to the object that a step is to make, at most 1. The default was tuned on wild
            worlds 3000 and up.
        spacing: Of the known positions, by the arm as built, in m. The default was tuned likewise.
    """

    privileged = ("gripper_position",)
    prior_knowledge = frozenset(
        {
            PriorKnowledge.IMAGE_SCALE,
            PriorKnowledge.NOISE,
            PriorKnowledge.ARM,
            PriorKnowledge.MOTOR_ORDER,
        }
    )
    DIRECTIONS = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    """In the room, one after the other, to the known positions: derived, the four are in no plane. To the
    side, ahead, down: there is room from home."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        gain: float = 0.6,
        spacing: float = 0.04,
        seed: int = 0,
    ) -> None:
        super().__init__(env, seed)
        self.gain = check_number("gain", gain, above=0, most=1)
        self.spacing = check_number("spacing", spacing, above=0)
        self._arm = RobotModel.of(nominal(), "stand")

    @property
    def kind(self) -> str:
        return f"AffineStereo(gain={self.gain}, spacing={self.spacing})"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        filter_ = ObservationFilter()
        now = yield from filter_.first(first)
        known = [now]
        for along in self.spacing * self.DIRECTIONS:
            now = yield from self._go(filter_, now, self._words(now, along))
            while not (now.visible | filter_.visibility.lost).all():
                now = yield from self._go(filter_, now, np.zeros_like(now.registers))
            known.append(now)
        affine = Affine.through(
            np.array([each.privileged["gripper_position"] for each in known]),
            np.array([each.points for each in known]),
            np.array([self._gripper_as_built(each) for each in known]),
        )
        while True:
            words = self._words(now, affine.step(now.distance, self.gain))
            now = yield from self._go(filter_, now, words, affine)

    def _go(
        self, filter_: ObservationFilter, before: Observation, words: Array, affine: Affine | None = None
    ) -> Observing:
        """Executes words (3,), and where that loses a point from view, goes half of the way back.

        Observations are trusted by what the affine function predicts.
        """
        last = before
        while True:
            now = yield words
            moved = np.zeros((POINTS, 2))
            if affine is not None:
                moved = affine.moved(self._gripper_as_built(now) - self._gripper_as_built(last))
            deviations_px = linear_deviations_px(moved, np.full(POINTS, affine is not None))
            last = yield from filter_.settle(now, last, last.points + moved, deviations_px)
            if not filter_.lost.any():
                return last
            words = half_way_back(before, last)

    def _gripper_as_built(self, observation: Observation) -> Array:
        """Where the arm as built has the gripper (3,), in m."""
        return self._arm.gripper(self._arm.joints(observation.registers[None]))[0]

    def _words(self, observation: Observation, along: Array) -> Array:
        """Control words (3,) that move the gripper of the arm as built by `along` (3,) in m."""
        target = self._gripper_as_built(observation) + along
        return self._arm.registers(target) - observation.registers


@dataclass(frozen=True)
class Affine:
    """An affine world, by what a displacement in the room does.

    Attributes:
        points: By a displacement, that of gripper and object points, coordinate after coordinate (8, 3).
        arm: By a displacement, that of the gripper of the arm as built (3, 3).
    """

    points: Array
    arm: Array

    @classmethod
    def through(cls, positions: Array, points: Array, positions_as_built: Array) -> Affine:
        """What four known positions determine.

        Args:
            positions: Of the gripper in the room (4, 3), in m.
            points: Image points (4, 4, 2) seen there.
            positions_as_built: Where the arm as built has the gripper (4, 3), in m.
        """
        rows = np.diff(np.hstack([points.reshape(len(points), -1), positions_as_built]), axis=0)
        by_room = np.asarray(np.linalg.lstsq(np.diff(positions, axis=0), rows, rcond=None)[0].T, float)
        return cls(by_room[: 2 * POINTS], by_room[2 * POINTS :])

    def step(self, distance: Array, gain: float) -> Array:
        """Displacement (3,) of the arm as built, in m, that is to undo so much of the image distance (4,)."""
        return -gain * self.arm @ np.linalg.lstsq(distance_jacobian(self.points), distance, rcond=None)[0]

    def moved(self, along: Array) -> Array:
        """Displacement (4, 2) of the points when the arm as built has moved by `along` (3,) in m."""
        in_room = np.linalg.lstsq(self.arm, along, rcond=None)[0]
        return np.asarray(self.points @ in_room).reshape(POINTS, 2)
