"""Perturbations of the arm and its motors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from calfree_gym.perturbations.base import Perturbation, amount, factor, one_of_the_arms, uniform, with_entry
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.world import World


@dataclass(frozen=True)
class JointZero(Perturbation):
    """Shifts a joint's zero by `degrees` (drawn: -10 to 10); a degree of a slide is a centimetre."""

    type: ClassVar[str] = "joint_zero"
    joint: str = one_of_the_arms("joints")
    degrees: float = amount(uniform(-10, 10), least=-180, most=180)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        joint = robot.joints.index(self.joint)
        shift = amount_of(robot, joint, self.degrees)
        return with_entry(world, "joint_zeros", joint, world.joint_zeros[joint] + shift)

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class LinkLength(Perturbation):
    """Multiplies a link's length by `factor` (drawn: 0.9-1.1)."""

    type: ClassVar[str] = "link_length"
    link: str = one_of_the_arms("links")
    factor: float = factor(0.9, 1.1)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        link = robot.links.index(self.link)
        return with_entry(world, "link_lengths", link, world.link_lengths[link] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class MotorGain(Perturbation):
    """Multiplies a motor's gain by `factor` (drawn: 0.67-1.5)."""

    type: ClassVar[str] = "motor_gain"
    motor: str = one_of_the_arms("motors")
    factor: float = factor(0.67, 1.5)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        motor = robot.motors.index(self.motor)
        return with_entry(world, "motor_gain", motor, world.motor_gain[motor] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)


@dataclass(frozen=True)
class MotorSign(Perturbation):
    """Reverses a motor."""

    type: ClassVar[str] = "motor_sign"
    drifts: ClassVar[bool] = False
    motor: str = one_of_the_arms("motors")

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        motor = robot.motors.index(self.motor)
        return with_entry(world, "motor_sign", motor, -world.motor_sign[motor])

    def inverse(self) -> Perturbation:
        return self


class _MotorError(Perturbation):
    """Sets the quantity that its `type` names; as a drift, adds to it."""

    motor: str
    degrees: float

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        place = robot.motors.index(self.motor)
        return with_entry(world, self.type, place, amount_of(robot, place, self.degrees))

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        place = robot.motors.index(self.motor)
        step = amount_of(robot, place, -self.degrees if back else self.degrees)
        return with_entry(world, self.type, place, getattr(world, self.type)[place] + step)


@dataclass(frozen=True)
class Backlash(_MotorError):
    """Sets a motor's backlash to `degrees` (drawn: 0.2-2; of a slide, centimetres); as a drift, adds it.

    Its joint lags behind by half of that, on either side.
    """

    type: ClassVar[str] = "backlash"
    motor: str = one_of_the_arms("motors")
    degrees: float = amount(uniform(0.2, 2.0), least=0, most=45)


@dataclass(frozen=True)
class Repeatability(_MotorError):
    """Sets the standard deviation of a motor's motions to `degrees` (drawn: 0.1-1); as a drift, adds it.

    Of a slide, they are centimetres.
    """

    type: ClassVar[str] = "repeatability"
    motor: str = one_of_the_arms("motors")
    degrees: float = amount(uniform(0.1, 1.0), least=0, most=45)


def amount_of(robot: Robot, motor: int, degrees: float) -> float:
    """Degrees of a joint in rad; of one that slides, centimetres in m. Joints behind the motors turn."""
    slides = motor < len(robot.motors) and robot.slides[motor]
    return degrees / 100 if slides else math.radians(degrees)
