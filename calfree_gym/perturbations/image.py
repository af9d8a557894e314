"""Perturbations of image points, and of the images in which they are found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from calfree_gym.geometry import direction_between
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.perturbations.base import (
    DRIFT_STEPS,
    Factor,
    Level,
    Perturbation,
    amount,
    any_size,
    factor,
    one_of,
    setting,
    uniform,
)
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.vision.image_formation import MAX_NOISE
from calfree_gym.world import WILD_AMBIENT, WILD_ELEVATION, WILD_STRENGTH, World, lamp
from calfree_gym.world.value import MAX_LATENCY


@dataclass(frozen=True)
class PointNoise(Level):
    """Sets the standard deviation of image coordinates to `px` (drawn: 0.5-5); as a drift, adds it."""

    type: ClassVar[str] = "point_noise"
    quantity: ClassVar[str] = "px"
    px: float = amount(any_size(0.5, 5), least=0, most=IMAGE_SIZE)


@dataclass(frozen=True)
class PointOutliers(Level):
    """Places a `share` (drawn: 0-0.4) of the image points anywhere in the image; as a drift, adds it."""

    type: ClassVar[str] = "point_outliers"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.4), least=0, most=1)


@dataclass(frozen=True)
class PointDropout(Level):
    """Hides a `share` (drawn: 0-0.4) of the image points; as a drift, adds it."""

    type: ClassVar[str] = "point_dropout"
    quantity: ClassVar[str] = "share"
    share: float = amount(uniform(0, 0.4), least=0, most=1)


@dataclass(frozen=True)
class Latency(Level):
    """Delays image points by `motions` (drawn: 1-3; as a drift: 1); as a drift, adds them."""

    type: ClassVar[str] = "latency"
    quantity: ClassVar[str] = "motions"
    motions: int = setting(
        lambda rng: int(rng.integers(1, 4)), least=0, most=MAX_LATENCY, whole=True, slow=lambda motions: 1
    )


@dataclass(frozen=True)
class Light(Perturbation):
    """Puts the lamp elsewhere and makes it another one; what is omitted is drawn as in wild worlds.

    The lamp stands at `azimuth`, from the room's x axis to its y axis, and `elevation` above the horizontal.
    `strength` is how brightly it lights what faces it, `ambient` how brightly all is lit from everywhere,
    both relative to white. As a drift, the light goes a hundredth of the way there in each step.
    """

    type: ClassVar[str] = "light"
    azimuth: float = setting(uniform(-180, 180))
    elevation: float = setting(uniform(*WILD_ELEVATION), least=5, most=90)
    strength: float = setting(uniform(*WILD_STRENGTH), least=0, most=2)
    ambient: float = setting(uniform(*WILD_AMBIENT), least=0, most=2)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return world.replace(**self._lamp())

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        share = -1 / (DRIFT_STEPS - 1) if back else 1 / DRIFT_STEPS
        there = self._lamp()
        direction = direction_between(world.light_direction, there.pop("light_direction"), share)
        levels = {name: (1 - share) * getattr(world, name) + share * level for name, level in there.items()}
        return world.replace(light_direction=direction, **levels)

    def _lamp(self) -> dict[str, Any]:
        return lamp(math.radians(self.azimuth), math.radians(self.elevation), self.strength, self.ambient)


@dataclass(frozen=True)
class Exposure(Factor):
    """Multiplies the brightness of a camera's images by `factor` (drawn: 0.6-1.6)."""

    type: ClassVar[str] = "exposure"
    quantity: ClassVar[str] = "exposure"
    camera: str = one_of("cameras")
    factor: float = factor(0.6, 1.6)


@dataclass(frozen=True)
class Blur(Level):
    """Sets the standard deviation of a camera's blur to `px` (drawn: 0.5-3); as a drift, adds it.

    They are pixels of an image of 512, on the longer side: small images may not change.
    """

    type: ClassVar[str] = "blur"
    quantity: ClassVar[str] = "px"
    camera: str = one_of("cameras")
    px: float = amount(uniform(0.5, 3), least=0, most=20)


@dataclass(frozen=True)
class ImageNoise(Level):
    """Sets the standard deviation of a camera's noise to grey `levels` (drawn: 3-12); as a drift, adds it."""

    type: ClassVar[str] = "image_noise"
    quantity: ClassVar[str] = "levels"
    camera: str = one_of("cameras")
    levels: float = amount(uniform(3, 12), least=0, most=MAX_NOISE)
