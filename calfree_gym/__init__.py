"""calfree_gym: a robot arm, two cameras and no calibration, as Gymnasium environments.

Importing it registers `CalFree/Reach-v0`, `CalFree/Grasp-v0` and `CalFree/SafeReach-v0`, and all of them with
dense rewards.
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

_SINGLE, _BATCHED, _GRASP, _SAFE = (
    "calfree_gym.envs." + module for module in ("single", "vector", "grasping", "safe_reaching")
)
_ENTRY_POINTS = {
    "Reach": (_SINGLE + ":make", _BATCHED + ":make"),
    "Grasp": (_GRASP + ":make", _GRASP + ":make_vec"),
    "SafeReach": (_SAFE + ":make", _SAFE + ":make_vec"),
}
_REWARDS = {"": "sparse", "Dense": "dense"}
ENV_IDS = tuple(f"CalFree/{task}{kind}-v0" for task in _ENTRY_POINTS for kind in _REWARDS)

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

for _task, (_single, _batched) in _ENTRY_POINTS.items():
    for _kind, _reward in _REWARDS.items():
        _arguments: dict[str, Any] = {"reward": _reward}
        gymnasium.register(
            f"CalFree/{_task}{_kind}-v0",
            entry_point=_single,
            vector_entry_point=_batched,
            max_episode_steps=60,
            kwargs=_arguments,
        )
