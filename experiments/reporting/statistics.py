"""Pure functions from samples to numbers with their uncertainty."""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


def interquartile_mean(values: Array) -> Array:
    """The mean of the middle half, over the first axis (Agarwal et al. 2021, "rliable").

    Args:
        values: Shape (runs, ...). A quarter of the runs, rounded down, is left out at each end.

    Returns:
        Shape (...).
    """
    cut = len(values) // 4
    middle = np.sort(values, axis=0)[cut : len(values) - cut]
    return np.asarray(middle.mean(axis=0))


def bootstrap_band(
    values: Array,
    statistic: Callable[[Array], Array],
    rng: np.random.Generator,
    level: float = 0.95,
    resamples: int = 2000,
) -> tuple[Array, Array]:
    """Percentile bootstrap of a statistic over whole runs: a run is drawn with all its trials.

    Args:
        values: Shape (runs, ...): each run's own numbers, its trials already averaged.
        statistic: From (runs, ...) to (...).
        rng: Draws the resamples.
        level: Part of the resamples that lies within the band.
        resamples: How many to draw.

    Returns:
        The lower and the upper edge, each of shape (...).
    """
    draws = rng.integers(len(values), size=(resamples, len(values)))
    resampled = np.stack([statistic(values[draw]) for draw in draws])
    tail = (1 - level) / 2
    low, high = np.quantile(resampled, [tail, 1 - tail], axis=0)
    return low, high


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """The interval of a proportion (Wilson 1927), which stays honest near 0 and 1.

    Raises:
        ValueError: Where there are no trials, or more successes than trials.
    """
    if trials <= 0 or not 0 <= successes <= trials:
        raise ValueError(f"found {successes} successes in {trials} trials; allowed: 0 to trials")
    z = NormalDist().inv_cdf((1 + level) / 2)
    rate = successes / trials
    centre = rate + z**2 / (2 * trials)
    spread = z * np.sqrt(rate * (1 - rate) / trials + z**2 / (4 * trials**2))
    scale = 1 + z**2 / trials
    return float((centre - spread) / scale), float((centre + spread) / scale)
