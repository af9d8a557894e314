"""The hidden world: as one value, how it is drawn, and how one is chosen."""

from calfree_gym.world.distributions import (
    DISTRIBUTIONS,
    FOCAL_LENGTH,
    WILD_AMBIENT,
    WILD_ELEVATION,
    WILD_STRENGTH,
    WorldChoice,
    WorldDistribution,
    lamp,
    log_uniform,
    nominal,
    wild_camera,
    wilder_camera,
    world_choices,
)
from calfree_gym.world.value import MAX_SHORTFALL, MAX_TEXTURE, World

__all__ = [
    "DISTRIBUTIONS",
    "FOCAL_LENGTH",
    "MAX_SHORTFALL",
    "MAX_TEXTURE",
    "WILD_AMBIENT",
    "WILD_ELEVATION",
    "WILD_STRENGTH",
    "World",
    "WorldChoice",
    "WorldDistribution",
    "lamp",
    "log_uniform",
    "nominal",
    "wild_camera",
    "wilder_camera",
    "world_choices",
]
