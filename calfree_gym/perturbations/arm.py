"""Perturbations of the arm, its motors and its registers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from calfree_gym.perturbations.base import (
    Factor,
    Level,
    Perturbation,
    amount,
    any_size,
    factor,
    one_of,
    setting,
    uniform,
    with_entry,
)
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.world import MAX_SHORTFALL, World


@dataclass(frozen=True)
class JointZero(Perturbation):
    """Shifts a joint's zero by `degrees` (drawn: -10 to 10); a degree of a slide is a centimetre."""

    type: ClassVar[str] = "joint_zero"
    joint: str = one_of("joints")
    degrees: float = amount(uniform(-10, 10), least=-180, most=180)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        joint = robot.joints.index(self.joint)
        shift = amount_of(robot, joint, self.degrees)
        return with_entry(world, "joint_zeros", joint, world.joint_zeros[joint] + shift)

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class LinkLength(Factor):
    """Multiplies a link's length by `factor` (drawn: 0.9-1.1)."""

    type: ClassVar[str] = "link_length"
    quantity: ClassVar[str] = "link_lengths"
    link: str = one_of("links")
    factor: float = factor(0.9, 1.1)


@dataclass(frozen=True)
class MotorGain(Factor):
    """Multiplies a motor's gain by `factor` (drawn: 0.67-1.5)."""

    type: ClassVar[str] = "motor_gain"
    quantity: ClassVar[str] = "motor_gain"
    motor: str = one_of("motors")
    factor: float = factor(0.67, 1.5)


@dataclass(frozen=True)
class MotorSign(Perturbation):
    """Reverses a motor."""

    type: ClassVar[str] = "motor_sign"
    drifts: ClassVar[bool] = False
    motor: str = one_of("motors")

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        motor = robot.motors.index(self.motor)
        return with_entry(world, "motor_sign", motor, -world.motor_sign[motor])

    def inverse(self) -> Perturbation:
        return self


class _MotorError(Level):
    quantity: ClassVar[str] = "degrees"
    motor: str

    def _in_world(self, robot: Robot, level: float) -> float:
        return amount_of(robot, robot.motors.index(self.motor), level)


@dataclass(frozen=True)
class Backlash(_MotorError):
    """Sets a motor's backlash to `degrees` (drawn: 0.2-2; of a slide, centimetres); as a drift, adds it.

    Its joint lags behind by half of that, on either side.
    """

    type: ClassVar[str] = "backlash"
    motor: str = one_of("motors")
    degrees: float = amount(uniform(0.2, 2.0), least=0, most=45)


@dataclass(frozen=True)
class Repeatability(_MotorError):
    """Sets the standard deviation of a motor's motions to `degrees` (drawn: 0.1-1); as a drift, adds it.

    Of a slide, they are centimetres.
    """

    type: ClassVar[str] = "repeatability"
    motor: str = one_of("motors")
    degrees: float = amount(uniform(0.1, 1.0), least=0, most=45)


def amount_of(robot: Robot, motor: int, degrees: float) -> float:
    """Degrees of a joint in rad; of one that slides, centimetres in m. Joints behind the motors turn."""
    slides = motor < len(robot.slides) and robot.slides[motor]
    return degrees / 100 if slides else math.radians(degrees)


NO_RIPPLE = 1.0, 0.0, 0.0


@dataclass(frozen=True)
class RegisterNoise(Level):
    """Sets the standard deviation of registers to `registers` (drawn: 0.0003-0.01); as a drift, adds it."""

    type: ClassVar[str] = "register_noise"
    quantity: ClassVar[str] = "registers"
    registers: float = amount(any_size(0.0003, 0.01), least=0, most=1)


@dataclass(frozen=True)
class RegisterStep(Level):
    """Rounds registers to multiples of `registers` (drawn: 0.0003-0.01); as a drift, adds it."""

    type: ClassVar[str] = "register_step"
    quantity: ClassVar[str] = "registers"
    registers: float = amount(any_size(0.0003, 0.01), least=0, most=1)


@dataclass(frozen=True)
class Shortfall(Level):
    """Leaves a `share` (drawn: 0.01-0.2) of each word unexecuted, of all motors; as a drift, adds it."""

    type: ClassVar[str] = "shortfall"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0.01, 0.2), least=0, most=MAX_SHORTFALL)


@dataclass(frozen=True)
class LongestMotion(Level):
    """Lets one motion execute at most `words` (drawn: 0.2-0.8) of all motors; as a drift, so much less."""

    type: ClassVar[str] = "longest_motion"
    quantity: ClassVar[str] = "words"
    words: float = amount(any_size(0.2, 0.8), least=1e-3, most=1)

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        return super().drift(world, not back, robot)


@dataclass(frozen=True)
class DeadZone(Level):
    """Lets words up to `words` (drawn: 0.003-0.03) leave a motor's joint where it is; as a drift, adds it.

    The register counts them.
    """

    type: ClassVar[str] = "dead_zone"
    quantity: ClassVar[str] = "words"
    motor: str = one_of("motors")
    words: float = amount(any_size(0.003, 0.03), least=0, most=1)


@dataclass(frozen=True)
class GearRipple(Perturbation):
    """Lets a motor's gain vary along its register by `depth` (drawn: 0.1-0.8), which registers do not tell.

    It repeats after `period` (drawn: 0.05-0.5 registers), and begins at home with `phase` (drawn: any, in
    degrees). As a drift, it adds `depth`; a gear that ripples already keeps its period and phase.
    """

    type: ClassVar[str] = "gear_ripple"
    motor: str = one_of("motors")
    depth: float = amount(uniform(0.1, 0.8), least=0, most=0.99)
    period: float = setting(any_size(0.05, 0.5), least=1e-3, most=1e3)
    phase: float = setting(uniform(-180, 180))

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        ripple = self.period, math.radians(self.phase), self.depth
        return with_entry(world, self.type, robot.motors.index(self.motor), ripple)

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        place = robot.motors.index(self.motor)
        period, phase, depth = world.gear_ripple[place].tolist()
        if depth == 0:
            period, phase = self.period, math.radians(self.phase)
        depth = round(depth + (-self.depth if back else self.depth), 9)
        self.check("depth", depth)
        return with_entry(world, self.type, place, (period, phase, depth) if depth else NO_RIPPLE)
