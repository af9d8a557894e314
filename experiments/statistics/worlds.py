"""Shares of trials, mean over worlds, with intervals of a Bayesian bootstrap with half a world at the bound.

Worlds are what is drawn at random, so they are the units: a world that is drawn comes with its trials. The
means of worlds differ by their trials too; drawn anew within each world, trials would count twice (Davison &
Hinkley 1997, section 3.8).

A bootstrap knows of no world that is worse than those seen: of 20 worlds that all succeed it says
[100 %, 100 %]. So each limit is found with half a world more, in which all trials fail (or succeed). A whole
one would make the interval exact for values of 0 and 1 (Clopper & Pearson 1934), and wide; half a one is what
Jeffreys' prior adds to a proportion (Brown, Cai & DasGupta 2001). The weights are those of Rubin's Bayesian
bootstrap (1981). `python -m experiments benchmark coverage` measures how often the truth lies inside.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from experiments.statistics.estimate import ENOUGH_WORLDS, LEVEL, Array, Estimate

PSEUDO_WORLDS = 0.5
"""At each bound."""
DRAWS = 4000
"""Of the weights. Reports draw the same ones for all numbers, and limits of shares in 20 worlds are off by up
to 0.8 %: where all succeed, the lower one is 88.9 %, with very many draws 88.1 %."""

SHARE = (0.0, 1.0)
"""The bounds of a share."""


def mean_share(successes: Array) -> Estimate:
    """The mean over worlds of a share of trials, with its interval where there are enough worlds.

    Args:
        successes: Of 0 and 1, or each world's share: (worlds,) or (worlds, trials).

    Raises:
        ValueError: There is no world, or a value outside 0 to 1.
    """
    successes = np.asarray(successes, float)
    return mean_shares(successes.reshape(len(successes), -1).mean(axis=1)[:, None])[0]


def mean_shares(values: Array, bounds: tuple[float, float] = SHARE) -> list[Estimate]:
    """As `mean_share`, for each column of shares (worlds, points), as a curve has them.

    Args:
        values: Shares, or differences of shares.
        bounds: The lowest and the highest value that a world can have.

    Raises:
        ValueError: There is no world, or a value outside the bounds.
    """
    values = np.asarray(values, float)
    low, high = bounds
    if not values.size or not ((values >= low) & (values <= high)).all():
        span = f"{values.min():g} to {values.max():g} in {len(values)} worlds" if values.size else "no world"
        raise ValueError(f"found {span}; allowed: one world or more, from {low:g} to {high:g}")
    means = values.mean(axis=0)
    if len(values) < ENOUGH_WORLDS:
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
