"""Pure functions from samples to numbers with their uncertainty; worlds are the units that are drawn."""

from experiments.statistics.censored import median_time, restricted_mean_time
from experiments.statistics.comparisons import (
    paired_difference,
    paired_shares,
    probability_of_improvement,
    probability_of_improvement_paired,
)
from experiments.statistics.estimands import (
    Estimand,
    interquartile_mean,
    lowest_decile,
    mean,
    median,
    quantile,
    worst_decile,
)
from experiments.statistics.estimate import Array, Estimate
from experiments.statistics.student import mean_estimate, relative_change
from experiments.statistics.worlds import (
    SHARE,
    bands,
    mean_share,
    over_trials,
    over_worlds,
    performance_profile,
)

__all__ = [
    "SHARE",
    "Array",
    "Estimand",
    "Estimate",
    "bands",
    "interquartile_mean",
    "lowest_decile",
    "mean",
    "mean_estimate",
    "mean_share",
    "median",
    "median_time",
    "over_trials",
    "over_worlds",
    "paired_difference",
    "paired_shares",
    "performance_profile",
    "probability_of_improvement",
    "probability_of_improvement_paired",
    "quantile",
    "relative_change",
    "restricted_mean_time",
    "worst_decile",
]
