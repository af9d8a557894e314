"""The calibrated robot that the paper argues against: it goes by its models (section 2.2)."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import gymnasium as gym
import numpy as np

from agents.base.agent import Array, Look, Procedure, ProcedureAgent
from agents.calibrated.model import CalibratedModel
from agents.perception.observation_filter import Senses
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
        self.model = CalibratedModel.of(nominal(), camera_mount)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"ModelBased(camera_mount={self.camera_mount!r})"

    def procedure(self, look: Look) -> Procedure:
        """Goes to where the object is by the model; where it misses, moves by what still lies between.

        The gripper is then triangulated with the object, so that what is wrong with both is wrong with
        neither (position-based look-and-move with the endpoint closed loop, after Hutchinson, Hager & Corke
        1996). What looks say of the goal goes through a scalar Kalman filter: it hardly matters unless they
        are noisy.
        """
        senses, model = Senses(), self.model
        look = yield from senses.first(look)
        goal, variance = np.zeros(3), np.inf
        while True:
            joints = model.joints(look.registers[None])
            gripper, object_ = model.triangulate(np.stack([look.gripper, look.object]), joints)
            seen = object_
            if look.registers.any():
                seen = model.gripper(joints)[0] + object_ - gripper
            variance += self.DRIFT_PX**2
            gain = 1.0 if np.isinf(variance) else variance / (variance + senses.noise_px**2)
            goal = goal + gain * (seen - goal)
            variance = senses.noise_px**2 * gain
            words = model.registers(goal) - look.registers
            look = (yield from move_by_model(model, object_, senses, look, words))[-1]


def move_by_model(
    model: CalibratedModel, object_: Array, senses: Senses, before: Look, words: Array
) -> Generator[Array, Look, list[Look]]:
    """Executes words (m,), and where that loses a point from view, goes half of the way back.

    Returns:
        The looks after each motion, trusted by what the model, and the object (3,), predict.
    """
    looks = [before]
    while True:
        look = yield words
        registers = np.stack([looks[-1].registers, look.registers])
        start, end = model.points(registers, np.stack([object_, object_]))
        looks.append((yield from senses.settle(look, looks[-1], end - start, np.ones(4, bool))))
        if not senses.lost.any():
            return looks[1:]
        words = (before.registers - looks[-1].registers) / 2
