"""The single and the batched Gymnasium environment, over one simulation."""

from calfree_gym.envs.single import StereoArmEnv
from calfree_gym.envs.vector import StereoArmVectorEnv

__all__ = ["StereoArmEnv", "StereoArmVectorEnv"]
