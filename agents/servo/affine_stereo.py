"""Affine stereo: image coordinates as an affine function of position (Hollinghurst & Cipolla 1994)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from agents.agent import Array, Look, Procedure, ProcedureAgent
from agents.calibration.calibrated_model import CalibratedModel
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
    manipulator" (paper, section 2.3).

    Args:
        gain: Share of the way to the object that a step is to make, below 1.
        spacing: Of the known positions, by the nominal arm, in m.
    """

    told = ("gripper_position",)

    def __init__(
        self,
        env: gym.Env[Any, Any],
        gain: float = 0.6,
        spacing: float = 0.04,
        seed: int = 0,
    ) -> None:
        super().__init__(env, seed)
        if not 0 < gain <= 1 or not spacing > 0:
            raise ValueError(f"gain is {gain}, spacing {spacing}; gain must be in (0, 1], spacing positive")
        self.gain = gain
        self.spacing = spacing
        self._arm = CalibratedModel.of(nominal(), "stand")

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"AffineStereo(gain={self.gain}, spacing={self.spacing})"

    def procedure(self, look: Look) -> Procedure:
        """See `ProcedureAgent`."""
        known = [look]
        for along in self.spacing * np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]):
            look = yield self._words(look, along)
            while not look.visible.all():
                look = yield (known[-1].registers - look.registers) / 2
            known.append(look)
        images = np.diff([look.distance for look in known], axis=0)
        told = np.diff([look.told["gripper_position"] for look in known], axis=0)
        believed = np.diff([self._believed(look) for look in known], axis=0)
        stereo = np.linalg.lstsq(told, images, rcond=None)[0].T
        arm = np.linalg.lstsq(told, believed, rcond=None)[0].T
        while True:
            wanted = -self.gain * np.linalg.lstsq(stereo, look.distance, rcond=None)[0]
            before = look
            look = yield self._words(look, arm @ wanted)
            while not look.visible.all():
                look = yield (before.registers - look.registers) / 2

    def _believed(self, look: Look) -> Array:
        """Where the nominal arm has the gripper (3,)."""
        return self._arm.gripper(self._arm.joints(look.registers[None]))[0]

    def _words(self, look: Look, along: Array) -> Array:
        """Control words (3,) that move the gripper of the nominal arm by `along` (3,) in m."""
        return self._arm.registers(self._believed(look) + along) - look.registers
