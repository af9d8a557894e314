"""Names by which specs and programs of earlier versions know `calfree_gym.tasks.reach`."""

from calfree_gym.tasks.reach import StereoArmVectorEnv

make = StereoArmGoalVectorEnv = StereoArmVectorEnv

__all__ = ["StereoArmGoalVectorEnv", "StereoArmVectorEnv", "make"]
