"""calfree_gym: a robot arm, two cameras and no calibration, as Gymnasium environments.

Importing it registers `CalFree/Reach-v0` and `CalFree/ReachDense-v0`.
"""

from typing import Any

import gymnasium

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
