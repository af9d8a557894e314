"""Two agents in the same worlds. Pairing takes out what the worlds have in common."""

import numpy as np

from experiments.statistics.estimate import Array, Estimate
from experiments.statistics.medians import median_world
from experiments.statistics.worlds import mean_share, mean_shares


def paired_motions(values: Array, reference: Array) -> Estimate:
    """By how much motions or seconds differ in the median world.

    Args:
        values: One a world (n,).
        reference: The other agent's in the same worlds (n,).
    """
    return median_world(np.asarray(values, float) - np.asarray(reference, float))


def paired_shares(shares: Array, reference: Array) -> Estimate:
    """By how much the mean over worlds of a share of trials differs.

    Args:
        shares: One a world (n,).
        reference: The other agent's in the same worlds (n,).
    """
    difference = np.asarray(shares, float) - np.asarray(reference, float)
    return mean_shares(difference[:, None], (-1.0, 1.0))[0]


def share_of_worlds(values: Array, reference: Array) -> Estimate:
    """The share of worlds in which an agent has the lower value than another; equal ones count half.

    It is the paired form of rliable's probability of improvement (Agarwal et al. 2021).

    Args:
        values: One a world (n,).
        reference: The other agent's in the same worlds (n,).
    """
    values, reference = np.asarray(values, float), np.asarray(reference, float)
    return mean_share((values < reference) + 0.5 * (values == reference))
