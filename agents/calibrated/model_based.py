"""The calibrated robot that the paper argues against: it goes by its models (section 2.2)."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import gymnasium as gym
import numpy as np

from agents.base.observation import Array, Observation
from agents.base.procedure import Procedure, ProcedureAgent
from agents.calibrated.robot_model import RobotModel
from agents.perception import ObservationFilter
from agents.servo.trial import half_way_back
from calfree_gym.world import nominal


class ModelBased(ProcedureAgent):
    """Stereo triangulation and inverse kinematics, by the model of the robot as it was built.

    It is told nothing in its observations; its knowledge is the builder's: lengths, joints and motors of the
    arm, where the cameras are and how they look, and what they are fixed to.

    Args:
        camera_mount: What the cameras are fixed to: "waist" or "stand".
    """

    DRIFT_PX = 1.0
    """By how much, seen in the images, the goal moves from motion to motion where the model is not true."""

    def __init__(self, env: gym.Env[Any, Any], camera_mount: str = "waist", seed: int = 0) -> None:
        super().__init__(env, seed)
        self.camera_mount = camera_mount
        self.model = RobotModel.of(nominal(), camera_mount)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"ModelBased(camera_mount={self.camera_mount!r})"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        """Goes to where the object is by the model; where it misses, moves by what still lies between.

        The gripper is then triangulated with the object, so that what is wrong with both is wrong with
        neither (position-based look-and-move with the endpoint closed loop, after Hutchinson, Hager & Corke
        1996). What observations say of the goal goes through a scalar Kalman filter: it hardly matters unless
        they are noisy.
        """
        filter_, model = ObservationFilter(), self.model
        now = yield from filter_.first(first)
        goal, variance = np.zeros(3), np.inf
        while True:
            joints = model.joints(now.registers[None])
            gripper, object_ = model.triangulate(np.stack([now.gripper, now.object]), joints)
            seen = object_
            if now.registers.any():
                seen = model.gripper(joints)[0] + object_ - gripper
            variance += self.DRIFT_PX**2
            gain = 1.0 if np.isinf(variance) else variance / (variance + filter_.noise.px**2)
            goal = goal + gain * (seen - goal)
            variance = filter_.noise.px**2 * gain
            words = model.registers(goal) - now.registers
            now = (yield from move_by_model(model, object_, filter_, now, words))[-1]


def move_by_model(
    model: RobotModel, object_: Array, filter_: ObservationFilter, before: Observation, words: Array
) -> Generator[Array, Observation, list[Observation]]:
    """Executes words (m,), and where that loses a point from view, goes half of the way back.

    Returns:
        The observations after each motion, trusted by what the model, and the object (3,), predict.
    """
    observations = [before]
    while True:
        now = yield words
        registers = np.stack([observations[-1].registers, now.registers])
        start, end = model.points(registers, np.stack([object_, object_]))
        moved = (end - start).reshape(4, 2)
        observations.append((yield from filter_.settle(now, observations[-1], moved, np.ones(4, bool))))
        if not filter_.lost.any():
            return observations[1:]
        words = half_way_back(before, observations[-1])
