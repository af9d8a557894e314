"""Perturbations of what a measurement adds to image points: noise, outliers, dropout, latency."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from calfree_gym.image import IMAGE_SIZE
from calfree_gym.perturbations.base import Perturbation, amount, setting, uniform
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.vision.latency import MAX_LATENCY
from calfree_gym.world import World, log_uniform


class _PointPerturbation(Perturbation):
    """Sets the field of the world that its type names; as a drift, adds to it.

    Attributes:
        quantity: The setting that holds the value.
    """

    quantity: ClassVar[str]

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return replace(world, **{self.type: np.array(getattr(self, self.quantity))})

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        step = getattr(self, self.quantity)
        there = getattr(world, self.type).item() + (-step if back else step)
        if self.settings()[self.quantity].whole:
            there = int(there)
        return replace(self, **{self.quantity: there}).change(world)  # type: ignore[type-var]


@dataclass(frozen=True)
class PointNoise(_PointPerturbation):
    """Sets the standard deviation of image coordinates to `px` (drawn: 0.5-5); as a drift, adds it."""

    type: ClassVar[str] = "point_noise"
    quantity: ClassVar[str] = "px"
    px: float = amount(lambda rng: float(log_uniform(rng, 0.5, 5)), least=0, most=IMAGE_SIZE)


@dataclass(frozen=True)
class PointOutliers(_PointPerturbation):
    """Places a `share` (drawn: 0-0.4) of the image points anywhere in the image; as a drift, adds it."""

    type: ClassVar[str] = "point_outliers"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.4), least=0, most=1)


@dataclass(frozen=True)
class PointDropout(_PointPerturbation):
    """Hides a `share` (drawn: 0-0.4) of the image points; as a drift, adds it."""

    type: ClassVar[str] = "point_dropout"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.4), least=0, most=1)


@dataclass(frozen=True)
class Latency(_PointPerturbation):
    """Delays image points by `motions` (drawn: 1-3; as a drift: 1); as a drift, adds them."""

    type: ClassVar[str] = "latency"
    quantity: ClassVar[str] = "motions"
    motions: int = setting(
        lambda rng: int(rng.integers(1, 4)), least=0, most=MAX_LATENCY, whole=True, slow=lambda motions: 1
    )
