"""The policy that is hand-eye calibrated as built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calfree_gym.geometry import Array, rotation_matrix
from experiments.fetch_reach.environment import CAMERA, FOVY, REACH, SIDE, fetch


class Calibrated:
    """Hand-eye calibrated as built: finds the goal by stereo; its registers tell where the gripper is."""

    def __init__(self) -> None:
        env: Any = fetch()
        env.reset(seed=0)
        built = env.unwrapped.data.camera(CAMERA)
        self._home = env.unwrapped.initial_gripper_xpos.copy()
        self._poses = (
            (built.xpos.copy(), built.xmat.reshape(3, 3).copy()),
            (np.array(SIDE.position), rotation_matrix(np.array(SIDE.orientation))),
        )
        self._half = np.tan(np.radians(FOVY) / 2)
        env.close()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) that lead to the goal."""
        here = self._home + REACH * observation["observation"][4:]
        return np.asarray(np.clip((self._goal(observation["desired_goal"]) - here) / REACH, -1, 1))

    def _goal(self, points: Array) -> Array:
        """The place (3,) that is nearest to both lines of sight."""
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for (position, axes), (x, y) in zip(self._poses, points.reshape(2, 2).astype(float), strict=True):
            sight = axes @ [self._half * x, -self._half * y, -1]
            across = np.eye(3) - np.outer(sight, sight) / (sight @ sight)
            normal, right = normal + across, right + across @ position
        return np.asarray(np.linalg.solve(normal, right), float)
