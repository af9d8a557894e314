"""Motors: what they execute of words, where their joints stand, and what registers tell."""

from calfree_gym.robot.motors.errors import MotorErrors
from calfree_gym.robot.motors.map import MotorMap, curve_inverse
from calfree_gym.robot.motors.registers import Registers

__all__ = ["MotorErrors", "MotorMap", "Registers", "curve_inverse"]
