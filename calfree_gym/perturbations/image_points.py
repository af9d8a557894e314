"""Perturbations of what a measurement adds to image points: noise, outliers, dropout, latency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calfree_gym.image import IMAGE_SIZE
from calfree_gym.perturbations.base import Level, amount, setting, uniform
from calfree_gym.vision.latency import MAX_LATENCY
from calfree_gym.world import log_uniform


@dataclass(frozen=True)
class PointNoise(Level):
    """Sets the standard deviation of image coordinates to `px` (drawn: 0.5-5); as a drift, adds it."""

    type: ClassVar[str] = "point_noise"
    quantity: ClassVar[str] = "px"
    px: float = amount(lambda rng: float(log_uniform(rng, 0.5, 5)), least=0, most=IMAGE_SIZE)


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
