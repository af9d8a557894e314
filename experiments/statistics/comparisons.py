"""Two agents in the same worlds, or in different ones."""

import numpy as np

from experiments.statistics.estimands import mean
from experiments.statistics.estimate import LEVEL, Array, Estimate
from experiments.statistics.student import mean_estimate
from experiments.statistics.worlds import SHARE, over_worlds, world_weights


def paired_difference(values: Array, reference: Array) -> Estimate:
    """By how much the mean of motions or seconds over worlds differs, with its t interval over worlds.

    Pairing takes out what the worlds have in common, so that differences are nearly symmetric: there the t
    interval is right (`benchmark coverage`), but not where one world in ten is bad for one agent alone. With
    bounds of ± 59 motions, as `paired_shares` has ± 1, no interval of 20 worlds would be shorter than 14.

    Args:
        values: One a world (n,).
        reference: The other agent's in the same worlds (n,).
    """
    return mean_estimate(np.asarray(values, float) - np.asarray(reference, float))


def paired_shares(shares: Array, reference: Array, rng: np.random.Generator) -> Estimate:
    """By how much the mean over worlds of a share of trials differs.

    Args:
        shares: One a world (n,).
        reference: The other agent's in the same worlds (n,).
        rng: Draws the weights.
    """
    difference = np.asarray(shares, float) - np.asarray(reference, float)
    return over_worlds(difference, mean, (-1.0, 1.0), rng)


def probability_of_improvement_paired(values: Array, reference: Array, rng: np.random.Generator) -> Estimate:
    """The share of worlds in which an agent has the higher value than another; equal ones count half.

    Args:
        values: One a world (n,).
        reference: The other agent's in the same worlds (n,).
        rng: Draws the weights.
    """
    return over_worlds(_higher(np.asarray(values, float), np.asarray(reference, float)), mean, SHARE, rng)


def probability_of_improvement(values: Array, reference: Array, rng: np.random.Generator) -> Estimate:
    """How likely an agent in one world has the higher value than another in another world.

    It is Mann and Whitney's U over the number of pairs, as in rliable (Agarwal et al. 2021).

    Args:
        values: One a world (n,).
        reference: The other agent's, in worlds of its own (m,).
        rng: Draws the weights of both.
    """
    values, reference = np.asarray(values, float), np.asarray(reference, float)
    higher = _higher(values[:, None], reference)
    mine, others = world_weights(len(values), rng)[:, :-1], world_weights(len(reference), rng)[:, :-1]
    of_seen = np.einsum("dn,nm,dm->d", mine, higher, others)
    unseen = 1 - mine.sum(axis=1) * others.sum(axis=1)  # pairs with a world at the bound
    tail = (1 - LEVEL) / 2
    return Estimate(
        float(higher.mean()),
        float(np.quantile(of_seen, tail)),
        float(np.quantile(of_seen + unseen, 1 - tail)),
    )


def _higher(values: Array, reference: Array) -> Array:
    return (values > reference) + 0.5 * (values == reference)
