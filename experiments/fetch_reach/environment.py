"""FetchReach, somebody else's environment, with two cameras of which one is turned.

It runs where gymnasium-robotics does: with MuJoCo below 3.11, which has no `mujoco.batch`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from calfree_gym.geometry import Array, looking_at
from calfree_gym.perturb import FixedCamera, StereoPoints, Words

CAMERA, FOVY = "external_camera_0", 60.0
"""The camera that is turned, and the field of view of both (degrees): by 20°, it still sees most goals."""
BESIDE, GRIPPER_AT_HOME = np.array([1.35, 1.75, 0.9]), np.array([1.34, 0.75, 0.53])
SIDE = FixedCamera(BESIDE, looking_at(BESIDE, GRIPPER_AT_HOME), FOVY)
"""The camera that stands still."""
WORDS = Words((0, 1, 2), steps=5, settle=4)
REACH = 0.05 * WORDS.steps
"""Metres that a word of 1 moves the gripper."""
NOISE_PX = 0.5
GRIPPER = "robot0:grip"
SUCCESS = 0.02
"""Within so many metres when the 50 steps of the environment are over."""
MIDDLE = 25
"""Steps of the environment."""


def aim(degrees: float, step: int = 0) -> list[dict[str, Any]]:
    """A schedule that turns the camera after so many steps, each time towards another side."""
    return [{"at": {"step": step}, "do": {"type": "camera_aim", "camera": CAMERA, "degrees": degrees}}]


SCHEDULES = {
    "as built": [],
    "5°": aim(5),
    "10°": aim(10),
    "20°": aim(20),
    "10° in mid-episode": aim(10, MIDDLE),
}


def fetch() -> gym.Env[Any, Any]:
    """FetchReach, with a wider lens."""
    import gymnasium_robotics

    gym.register_envs(gymnasium_robotics)
    env = gym.make("FetchReach-v4")
    env.unwrapped.model.camera(CAMERA).fovy = FOVY  # type: ignore[attr-defined]
    return env


def draw_goal(env: gym.Env[Any, Any]) -> None:
    """Puts the red ball at the goal, as FetchReach's own `render` does; physics know nothing of it."""
    made: Any = env.unwrapped
    made.data.site("target0").xpos[:] = made.goal


def points_of(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """As policies see it that go by image points."""
    return StereoPoints(
        env,
        GRIPPER,
        lambda env: env.unwrapped.goal,  # type: ignore[attr-defined]
        (CAMERA, SIDE),
        WORDS,
        registers=_registers,
        noise_px=NOISE_PX,
        terminate_on_success=False,
    )


def _registers(env: gym.Env[Any, Any]) -> Array:
    """Where the gripper stands, as joints tell it, in words from home (3,); words fall short by a third."""
    made: Any = env.unwrapped
    return np.asarray((made.data.site(GRIPPER).xpos - made.initial_gripper_xpos) / REACH)


def succeeded(env: gym.Env[Any, Any], info: Mapping[str, Any]) -> bool:
    """Whether the gripper is at the goal."""
    made: Any = env.unwrapped
    return bool(np.linalg.norm(made.data.site(GRIPPER).xpos - made.goal) < SUCCESS)
