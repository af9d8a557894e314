"""Perturbations of a mobile base: its wheels, and where its dock stands."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, cast

import numpy as np

from calfree_gym.perturbations.base import (
    Factor,
    Level,
    Perturbation,
    amount,
    factor,
    one_of,
    setting,
    uniform,
)
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.docking.base import MARKS, Base
from calfree_gym.world import World
from calfree_gym.world.value import MAX_SLIP

BUILT = cast(Robot, Base("differential", 1, len(MARKS)))


class OfABase(Perturbation):
    """A perturbation that only a robot on wheels can have."""

    built: ClassVar[Robot] = BUILT

    def check_fits(self, robot: Robot) -> None:
        """See `Perturbation`."""
        if not robot.wheels:
            raise ValueError(f"{self.type} is of a robot on wheels; this one has none")
        super().check_fits(robot)


@dataclass(frozen=True)
class WheelRadius(OfABase, Factor):
    """Multiplies a wheel's radius by `factor` (drawn: 0.8-1.25), as a worn or another wheel has it."""

    type: ClassVar[str] = "wheel_radius"
    quantity: ClassVar[str] = "motor_gain"
    wheel: str = one_of("wheels")
    factor: float = factor(0.8, 1.25)


@dataclass(frozen=True)
class Track(OfABase, Factor):
    """Multiplies how far the wheels stand apart by `factor` (drawn: 0.8-1.25)."""

    type: ClassVar[str] = "track"
    quantity: ClassVar[str] = "link_lengths"
    factor: float = factor(0.8, 1.25)


@dataclass(frozen=True)
class Slip(OfABase, Level):
    """Sets the standard deviation of a wheel's way, as a `share` of it (drawn: 0-0.03); a drift adds it."""

    type: ClassVar[str] = "slip"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.03), least=0, most=MAX_SLIP)


@dataclass(frozen=True)
class DockMoved(OfABase):
    """Moves the dock by `metres` (drawn: 0.05-0.3), and turns it by `degrees` (drawn: -10 to 10).

    `azimuth` (drawn: any) is where to, in degrees from the room's x axis to its y axis. Trials start where
    they did; a robot that is under way stays where it is.
    """

    type: ClassVar[str] = "dock_moved"
    metres: float = amount(uniform(0.05, 0.3))
    azimuth: float = setting(uniform(-180, 180))
    degrees: float = amount(uniform(-10, 10))

    def change(self, world: World, robot: Robot = BUILT) -> World:
        azimuth = math.radians(self.azimuth)
        way = [self.metres * math.cos(azimuth), self.metres * math.sin(azimuth), math.radians(self.degrees)]
        return world.replace(dock=world.dock + np.array(way))

    def inverse(self) -> Perturbation:
        return replace(self, metres=-self.metres, degrees=-self.degrees)
