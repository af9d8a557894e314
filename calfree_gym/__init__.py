"""calfree_gym: a robot arm, two cameras and no calibration, as Gymnasium environments.

Importing it registers the environments of `ENV_IDS`: each task, and some with a dense reward, too.

In a wheel controllers are in `calfree_agents`. Examples are run as `python -m calfree_gym.examples.servo`;
others are `knocked_camera`, `own_robot`, `ppo_sb3`, `ppo_cleanrl` and `sac_her_sb3`.
"""

import os

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

from calfree_gym.perturb import Perturb, StereoPoints, paired
from calfree_gym.robot.arms.arm import Arm
from calfree_gym.vision.cameras import MOUNTS
from calfree_gym.world import DISTRIBUTIONS, World, WorldDistribution, nominal

_BOTH = ("", "Dense")
_TASKS = {
    "Reach": ("reach:StereoArmEnv", "reach:StereoArmVectorEnv", _BOTH),
    "SafeReach": ("safe_reach:SafeReachEnv", "safe_reach:SafeReachVectorEnv", _BOTH),
    "Grasp": ("grasp:GraspEnv", "grasp:GraspVectorEnv", _BOTH),
    "Insert": ("insert:InsertEnv", "insert:InsertVectorEnv", ("",)),
    "Dock": ("dock:DockEnv", "dock:DockVectorEnv", _BOTH),
}
"""Of each task: its environments, single and batched, and the rewards that it has besides the sparse one."""
_REWARDS = {"": "sparse", "Dense": "dense"}
ENV_IDS = tuple(f"CalFree/{task}{kind}-v0" for task, (*_, kinds) in _TASKS.items() for kind in kinds)

__version__ = "1.0.0"

__all__ = [
    "DISTRIBUTIONS",
    "ENV_IDS",
    "MOUNTS",
    "Arm",
    "Perturb",
    "StereoPoints",
    "World",
    "WorldDistribution",
    "__version__",
    "nominal",
    "paired",
]

for _task, (_single, _batched, _kinds) in _TASKS.items():
    for _kind in _kinds:
        gymnasium.register(
            f"CalFree/{_task}{_kind}-v0",
            entry_point=f"calfree_gym.tasks.{_single}",
            vector_entry_point=f"calfree_gym.tasks.{_batched}",
            max_episode_steps=60,
            kwargs={"reward": _REWARDS[_kind]} if len(_kinds) > 1 else {},
        )
