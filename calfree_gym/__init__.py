"""calfree_gym: a robot arm, two cameras and no calibration, as Gymnasium environments.

Importing it registers `CalFree/Reach-v0` and `CalFree/ReachDense-v0`.
"""

import os
from typing import Any

import gymnasium

try:
    import mujoco as mujoco  # it loads the renderer that MUJOCO_GL names
except Exception as error:
    if "MUJOCO_GL" not in os.environ:
        raise
    raise gymnasium.error.DependencyNotInstalled(
        f"MuJoCo cannot load the renderer of MUJOCO_GL={os.environ['MUJOCO_GL']} ({error}). Unset it, or set "
        "it to egl (Debian: libegl1 and libgl1-mesa-dri), osmesa (libosmesa6), glfw (needs a screen), or "
        "disable (no images)."
    ) from error

from calfree_gym.robot.arms.arm import Arm
from calfree_gym.vision.cameras import MOUNTS
from calfree_gym.world import DISTRIBUTIONS, World, WorldDistribution, nominal

_REWARDS = {"CalFree/Reach-v0": "sparse", "CalFree/ReachDense-v0": "dense"}
ENV_IDS = tuple(_REWARDS)

__version__ = "0.1.0"

__all__ = [
    "DISTRIBUTIONS",
    "ENV_IDS",
    "MOUNTS",
    "Arm",
    "World",
    "WorldDistribution",
    "__version__",
    "nominal",
]

for _id, _reward in _REWARDS.items():
    _arguments: dict[str, Any] = {"reward": _reward}
    gymnasium.register(
        _id,
        entry_point="calfree_gym.envs.single:make",
        vector_entry_point="calfree_gym.envs.vector:make",
        max_episode_steps=60,
        kwargs=_arguments,
    )
