"""Pure functions from samples to numbers with their uncertainty; worlds are the units that are drawn."""

from experiments.statistics.censored import median_time
from experiments.statistics.comparisons import paired_motions, paired_shares, share_of_worlds
from experiments.statistics.estimate import ENOUGH_WORLDS, Array, Estimate
from experiments.statistics.medians import median_world, medians, most_worlds
from experiments.statistics.student import mean_estimate, relative_change
from experiments.statistics.worlds import SHARE, mean_share, mean_shares, performance_profile

__all__ = [
    "ENOUGH_WORLDS",
    "SHARE",
    "Array",
    "Estimate",
    "mean_estimate",
    "mean_share",
    "mean_shares",
    "median_time",
    "median_world",
    "medians",
    "most_worlds",
    "paired_motions",
    "paired_shares",
    "performance_profile",
    "relative_change",
    "share_of_worlds",
]
