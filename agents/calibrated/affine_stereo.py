"""Affine stereo: image coordinates as an affine function of position (Hollinghurst & Cipolla 1994)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from agents.base.checks import check_number
from agents.base.observation import Array, Observation
from agents.base.procedure import Procedure, ProcedureAgent
from agents.calibrated.robot_model import RobotModel
from agents.jacobian import distance_jacobian
from agents.perception import ObservationFilter, Observing
from agents.servo.trial import half_way_back
from calfree_gym.world import nominal


class AffineStereo(ProcedureAgent):
    """Self-calibrates at four known positions, then goes to the object in proportional steps.

    From the reference: far from the cameras the four image coordinates are an affine function of position,
    whose 16 parameters four known positions, not in one plane, give exactly; steps in three dimensions with a
    gain below 1 make up for what is not affine. It is told the gripper's position in the room, and heeds it
    at these four only: at home and after three motions, in every trial.

    Reconstructions: the affine function is that of the image distance d, so that it also holds where cameras
    turn with the waist and move the object in the images; and positions become words by the nominal arm,
    whose linear errors, told the same four positions, are corrected: "linear modeling errors of the
    manipulator" (paper, section 2.3). An arm whose motors turn the other way, or twice as far, is no linear
    error: in wild worlds a quarter to a third of the trials fail.

    Args:
        gain: Share of the way to the object that a step is to make, below 1.
        spacing: Of the known positions, by the nominal arm, in m.
    """

    privileged = ("gripper_position",)

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
        """See `ProcedureAgent`."""
        return f"AffineStereo(gain={self.gain}, spacing={self.spacing})"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        """See `ProcedureAgent`."""
        filter_ = ObservationFilter()
        now = yield from filter_.first(first)
        known = [now]
        for along in self.spacing * np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]):
            now = yield from self._go(filter_, now, self._words(now, along))
            known.append(now)
        affine = Affine.through(
            np.array([each.privileged["gripper_position"] for each in known]),
            np.array([each.points.ravel() for each in known]),
            np.array([self._by_nominal_arm(each) for each in known]),
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
            moved = np.zeros((4, 2))
            if affine is not None:
                moved = affine.moved(self._by_nominal_arm(now) - self._by_nominal_arm(last))
            last = yield from filter_.settle(now, last, moved, np.full(4, affine is not None))
            if not filter_.lost.any():
                return last
            words = half_way_back(before, last)

    def _by_nominal_arm(self, observation: Observation) -> Array:
        """Where the nominal arm has the gripper (3,)."""
        return self._arm.gripper(self._arm.joints(observation.registers[None]))[0]

    def _words(self, observation: Observation, along: Array) -> Array:
        """Control words (3,) that move the gripper of the nominal arm by `along` (3,) in m."""
        target = self._by_nominal_arm(observation) + along
        return self._arm.registers(target) - observation.registers


@dataclass(frozen=True)
class Affine:
    """An affine world, by what a displacement in the room does.

    Attributes:
        points: To gripper and object points (8, 3).
        arm: To where the nominal arm has the gripper (3, 3).
    """

    points: Array
    arm: Array

    @classmethod
    def through(cls, positions: Array, points: Array, nominal_positions: Array) -> Affine:
        """What four positions (4, 3), their image points (4, 8) and the nominal arm's (4, 3) determine."""
        rows = np.diff(np.hstack([points, nominal_positions]), axis=0)
        by_room = np.asarray(np.linalg.lstsq(np.diff(positions, axis=0), rows, rcond=None)[0].T, float)
        return cls(by_room[:8], by_room[8:])

    def step(self, distance: Array, gain: float) -> Array:
        """Displacement (3,) of the nominal arm that is to undo so much of the image distance (4,)."""
        return -gain * self.arm @ np.linalg.lstsq(distance_jacobian(self.points), distance, rcond=None)[0]

    def moved(self, along: Array) -> Array:
        """Displacement (4, 2) of the points when the nominal arm has moved by `along` (3,) in m."""
        return np.asarray(self.points @ np.linalg.lstsq(self.arm, along, rcond=None)[0]).reshape(4, 2)
