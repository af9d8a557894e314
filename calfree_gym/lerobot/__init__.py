"""A real arm through LeRobot's `Robot` interface, and nothing else; LeRobot is not imported."""

from calfree_gym.lerobot.environment import LeRobotReachEnv, ReachRecord
from calfree_gym.lerobot.faults import ArmError

__all__ = ["ArmError", "LeRobotReachEnv", "ReachRecord"]
