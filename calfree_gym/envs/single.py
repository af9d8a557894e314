"""Names by which specs and programs of earlier versions know `calfree_gym.tasks.reach`."""

from calfree_gym.engine.single import ArmEnv
from calfree_gym.tasks.reach import StereoArmEnv

make = StereoArmGoalEnv = StereoArmEnv

__all__ = ["ArmEnv", "StereoArmEnv", "StereoArmGoalEnv", "make"]
