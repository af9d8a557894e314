"""calfree_gym: a robot arm, two cameras and no calibration, as Gymnasium environments.

Importing it registers `CalFree/Reach-v0`, `CalFree/SafeReach-v0` and `CalFree/Grasp-v0`, all with dense
rewards, too, and `CalFree/Insert-v0`.
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

_ENVS = "calfree_gym.envs."
_ENTRY_POINTS = {
    "Reach": (_ENVS + "single:make", _ENVS + "vector:make"),
    "SafeReach": (_ENVS + "safe_reaching:make", _ENVS + "safe_reaching:make_vec"),
    "Grasp": (_ENVS + "grasping:make", _ENVS + "grasping:make_vec"),
    "Insert": (_ENVS + "inserting:InsertEnv", _ENVS + "inserting:InsertVectorEnv"),
}
_BOTH = {"": {"reward": "sparse"}, "Dense": {"reward": "dense"}}
_REWARDS: dict[str, dict[str, dict[str, Any]]] = {
    "Reach": _BOTH,
    "SafeReach": _BOTH,
    "Grasp": _BOTH,
    "Insert": {"": {}},
}
ENV_IDS = tuple(f"CalFree/{task}{kind}-v0" for task, kinds in _REWARDS.items() for kind in kinds)

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
    for _kind, _arguments in _REWARDS[_task].items():
        gymnasium.register(
            f"CalFree/{_task}{_kind}-v0",
            entry_point=_single,
            vector_entry_point=_batched,
            max_episode_steps=60,
            kwargs=_arguments,
        )
