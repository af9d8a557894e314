"""Perturbations of the arm and its motors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from calfree_gym.perturbations.base import Perturbation, amount, factor, one_of, uniform, with_entry
from calfree_gym.robot.motors import MOTORS
from calfree_gym.world import LINKS, World

JOINTS = ("J1", "J2", "J3", "J4")


@dataclass(frozen=True)
class JointZero(Perturbation):
    """Shifts a joint's zero by `degrees` (drawn: -10 to 10)."""

    type: ClassVar[str] = "joint_zero"
    joint: str = one_of(JOINTS)
    degrees: float = amount(uniform(-10, 10))

    def change(self, world: World) -> World:
        joint = JOINTS.index(self.joint)
        return with_entry(world, "joint_zeros", joint, world.joint_zeros[joint] + math.radians(self.degrees))

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class LinkLength(Perturbation):
    """Multiplies a link's length by `factor` (drawn: 0.9-1.1)."""

    type: ClassVar[str] = "link_length"
    link: str = one_of(LINKS)
    factor: float = factor(0.9, 1.1)

    def change(self, world: World) -> World:
        link = LINKS.index(self.link)
        return with_entry(world, "link_lengths", link, world.link_lengths[link] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class MotorGain(Perturbation):
    """Multiplies a motor's gain by `factor` (drawn: 0.67-1.5)."""

    type: ClassVar[str] = "motor_gain"
    motor: str = one_of(MOTORS)
    factor: float = factor(0.67, 1.5)

    def change(self, world: World) -> World:
        motor = MOTORS.index(self.motor)
        return with_entry(world, "motor_gain", motor, world.motor_gain[motor] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class MotorSign(Perturbation):
    """Reverses a motor."""

    type: ClassVar[str] = "motor_sign"
    motor: str = one_of(MOTORS)

    def change(self, world: World) -> World:
        motor = MOTORS.index(self.motor)
        return with_entry(world, "motor_sign", motor, -world.motor_sign[motor])

    def inverse(self) -> Perturbation:
        return self
