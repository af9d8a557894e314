"""The environments of reaching; `gymnasium.make` makes those of every task."""

from calfree_gym.tasks.reach import StereoArmEnv, StereoArmVectorEnv

__all__ = ["StereoArmEnv", "StereoArmVectorEnv"]
