"""Numbers over worlds with their intervals: shares of trials, the median world, means, times, comparisons.

Worlds are what is drawn at random, so they are the units: a world that is drawn comes with its trials. The
means of worlds differ by their trials too; drawn anew within each world, trials would count twice (Davison &
Hinkley 1997, section 3.8). `python -m experiments benchmark coverage` measures how often they hold the truth.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import scipy.stats
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.95
"""Of all intervals in tables."""
ENOUGH_WORLDS = 20
"""With fewer, numbers over worlds have no interval, single worlds are drawn, and nobody is ranked. Functions
take another number as `enough`."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval; both limits are NaN where it has none."""

    value: float
    low: float = math.nan
    high: float = math.nan

    @property
    def has_interval(self) -> bool:
        """Whether there were enough worlds for one."""
        return not math.isnan(self.low)


# Shares of trials: mean over worlds, with intervals of a Bayesian bootstrap with half a world at the bound.
#
# A bootstrap knows of no world that is worse than those seen: of 20 worlds that all succeed it says [100 %,
# 100 %]. So each limit is found with half a world more, in which all trials fail (or succeed). A whole one
# would make the interval exact for values of 0 and 1 (Clopper & Pearson 1934), and wide; half a one is what
# Jeffreys' prior adds to a proportion (Brown, Cai & DasGupta 2001). The weights are those of Rubin's
# Bayesian bootstrap (1981).

PSEUDO_WORLDS = 0.5
"""At each bound."""
DRAWS = 4000
"""Of the weights. Reports draw the same ones for all numbers, and limits of shares in 20 worlds are off by up
to 0.8 %: where all succeed, the lower one is 88.9 %, with very many draws 88.1 %."""
SHARE = (0.0, 1.0)
"""The bounds of a share."""
EQUAL = 1e-12
"""Shares and limits of intervals that differ by no more are equal: they are rounded."""


def mean_share(successes: Array, enough: int = ENOUGH_WORLDS) -> Estimate:
    """The mean over worlds of a share of trials, with its interval where there are enough worlds.

    Args:
        successes: Of 0 and 1, or each world's share: (worlds,) or (worlds, trials).
        enough: Worlds.

    Raises:
        ValueError: There is no world, or a value outside 0 to 1.
    """
    successes = np.asarray(successes, float)
    return mean_shares(successes.reshape(len(successes), -1).mean(axis=1)[:, None], enough=enough)[0]


def mean_shares(
    values: Array, bounds: tuple[float, float] = SHARE, enough: int = ENOUGH_WORLDS
) -> list[Estimate]:
    """As `mean_share`, for each column of shares (worlds, points), as a curve has them.

    Args:
        values: Shares, or differences of shares.
        bounds: The lowest and the highest value that a world can have.
        enough: Worlds.

    Raises:
        ValueError: There is no world, or a value outside the bounds.
    """
    values = np.asarray(values, float)
    low, high = bounds
    if not values.size or not ((values >= low) & (values <= high)).all():
        span = f"{values.min():g} to {values.max():g} in {len(values)} worlds" if values.size else "no world"
        raise ValueError(f"found {span}; allowed: one world or more, from {low:g} to {high:g}")
    means = values.mean(axis=0)
    if len(values) < enough:
        return [Estimate(float(value)) for value in means]
    weights = world_weights(len(values))
    seen, unseen = weights[:, :-1] @ values, weights[:, -1:]
    tail = (1 - LEVEL) / 2
    lows = np.quantile(seen + low * unseen, tail, axis=0).clip(low)
    highs = np.quantile(seen + high * unseen, 1 - tail, axis=0).clip(max=high)
    return [
        Estimate(float(value), float(min(lowest, value)), float(max(highest, value)))
        for value, lowest, highest in zip(means, lows, highs, strict=True)
    ]


@lru_cache(maxsize=4)
def world_weights(worlds: int) -> Array:
    """Weights (DRAWS, worlds + 1) of the worlds and, last, of that at the bound; each row sums to 1.

    Always the same ones, so that a number depends on nothing that was computed before it.
    """
    rng = np.random.default_rng(0)
    drawn = rng.standard_gamma([1.0] * worlds + [PSEUDO_WORLDS], (DRAWS, worlds + 1))
    return np.asarray(drawn / drawn.sum(axis=1, keepdims=True))


def performance_profile(errors: Array, within: Sequence[float]) -> list[Estimate]:
    """The share of trials whose error is at most so large, mean over worlds (Agarwal et al. 2021).

    Args:
        errors: Of each trial (worlds, trials).
        within: The thresholds.
    """
    inside = np.asarray(errors, float)[:, :, None] <= np.asarray(within, float)
    return mean_shares(inside.mean(axis=1))


# The median world: half of all worlds lie below. Its interval is exact: it ends at two of the worlds that
# were seen, however worlds are distributed (order statistics). So no world that was not met widens it, and
# one bad world in ten does not move it.


def median_world(values: Array, enough: int = ENOUGH_WORLDS) -> Estimate:
    """The median over worlds, with its interval where there are enough.

    Args:
        values: One a world (n,); NaN in those that have none, which are left out.
        enough: Worlds that have one.
    """
    values = np.asarray(values, float)
    found = np.sort(values[~np.isnan(values)])
    if not found.size:
        return Estimate(np.nan)
    value = float(np.median(found))
    if len(found) < enough:
        return Estimate(value)
    ranks = _ranks(len(found))
    return Estimate(value, *(float(found[rank]) for rank in ranks)) if ranks else Estimate(value)


def medians(values: Array) -> list[Estimate]:
    """As `median_world`, for each column of values (n, points), as a curve has them."""
    return [median_world(column) for column in np.asarray(values, float).T]


@cache
def _ranks(worlds: int) -> tuple[int, int] | None:
    """Between which of so many sorted worlds the median lies; None where that cannot be said."""
    interval = scipy.stats.quantile_test(np.arange(worlds), p=0.5).confidence_interval(LEVEL)
    return None if np.isnan(interval).any() else (int(interval.low), int(interval.high))


def most_worlds(values: Array) -> tuple[float, float]:
    """The 10th and the 90th percentile of worlds (n,); the lowest and the highest where they are few."""
    low, high = (0.1, 0.9) if len(values) >= ENOUGH_WORLDS else (0.0, 1.0)
    found = np.quantile(np.asarray(values, float), (low, high))
    return float(found[0]), float(found[1])


# Means and their changes, with Student's t intervals, where the values of worlds are nearly symmetric.


def mean_estimate(values: Array) -> Estimate:
    """The mean of independent values (n,), with its t interval; of one value nothing is known but itself."""
    mean = float(values.mean())
    if len(values) < 2:
        return Estimate(mean, -np.inf, np.inf)
    deviation = float(values.std(ddof=1)) / np.sqrt(len(values))
    half = float(scipy.stats.t.ppf((1 + LEVEL) / 2, len(values) - 1)) * deviation
    return Estimate(mean, mean - half, mean + half)


def relative_change(before: Array, after: Array) -> Estimate:
    """The share by which a mean changes, with its t interval.

    The change is that of a ratio of means; the interval is that of its linear part in each pair.

    Args:
        before: One value a unit (n,).
        after: The same units' values after the change (n,).
    """
    change = float(after.mean() / before.mean()) - 1
    around = mean_estimate((after - (1 + change) * before) / before.mean())
    return Estimate(change, change + around.low, change + around.high)


# Two agents in the same worlds (n,). Pairing takes out what the worlds have in common.


def paired_motions(values: Array, reference: Array, enough: int = ENOUGH_WORLDS) -> Estimate:
    """By how much motions or seconds differ in the median world."""
    return median_world(np.asarray(values, float) - np.asarray(reference, float), enough)


def paired_shares(shares: Array, reference: Array, enough: int = ENOUGH_WORLDS) -> Estimate:
    """By how much the mean over worlds of a share of trials differs."""
    difference = np.asarray(shares, float) - np.asarray(reference, float)
    return mean_shares(difference[:, None], (-1.0, 1.0), enough)[0]


def share_of_worlds(values: Array, reference: Array) -> Estimate:
    """The share of worlds in which an agent has the lower value than another; equal ones count half.

    It is the paired form of rliable's probability of improvement (Agarwal et al. 2021).
    """
    values, reference = np.asarray(values, float), np.asarray(reference, float)
    return mean_share((values < reference) + 0.5 * (values == reference))


# Motions until something is reached, where some runs end before it: right-censored times. A run that ends at
# 10,000 motions without the threshold says that its time is longer than that, and no more.


def median_time(times: Array, reached: NDArray[np.bool_]) -> Estimate:
    """The median time by Kaplan and Meier (1958); infinite where half of the worlds have not reached it.

    Of an even number of worlds it lies amid the two in the middle. Its interval, where there are enough
    worlds, is Brookmeyer and Crowley's (1982): the times at which the log-log interval of the share that has
    not reached it holds one half.

    Args:
        times: When each world reached it, or was last looked at (n,).
        reached: Whether it did (n,).
    """
    times, reached = np.asarray(times, float), np.asarray(reached, bool)
    left = scipy.stats.ecdf(scipy.stats.CensoredData.right_censored(times, ~reached)).sf
    half, most = (_first_below(left.quantiles, left.probabilities, 0.5 + each) for each in (EQUAL, -EQUAL))
    value = (half + most) / 2
    if len(times) < ENOUGH_WORLDS:
        return Estimate(value)
    with warnings.catch_warnings():  # where all or none are left it is undefined: these are taken as they are
        warnings.simplefilter("ignore", RuntimeWarning)
        band = left.confidence_interval(LEVEL, method="log-log")
    edges = (
        np.where(np.isnan(edge.probabilities), left.probabilities, edge.probabilities)
        for edge in (band.low, band.high)
    )
    return Estimate(value, *(_first_below(left.quantiles, edge, 0.5 + EQUAL) for edge in edges))


def _first_below(times: Array, left: Array, share: float) -> float:
    """The first time after which less than this share is left."""
    below = left < share
    return float(times[below.argmax()]) if below.any() else np.inf
