"""The environments of reaching under their earlier names; see `calfree_gym.tasks`."""

import warnings

from calfree_gym.tasks.reach import StereoArmEnv, StereoArmVectorEnv

__all__ = ["StereoArmEnv", "StereoArmVectorEnv"]

warnings.warn("calfree_gym.envs is now calfree_gym.tasks", DeprecationWarning, stacklevel=2)
