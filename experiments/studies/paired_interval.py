"""How often Tango's interval of a paired difference holds the truth: exact sums, no simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
import pandas as pd
from scipy.special import gammaln, xlogy

from calfree_gym.geometry import Array
from calfree_gym.perturb.paired_shares import score_interval
from experiments.reporting.tables import Table

DISCORDANT = (*np.arange(0.005, 0.1, 0.005).tolist(), *np.arange(0.1, 1.0, 0.025).tolist())
"""Shares of pairs that differ, in truth."""
ONE_SIDED = (0.0, 0.1, 0.25, 0.5)
"""Shares of these that are won."""
ROUNDING = 1e-12


def tables(sizes: Sequence[int] = range(30, 101)) -> Iterator[Table]:
    """The smallest coverage, by how one-sided differing pairs are."""
    rows = []
    for one_side in ONE_SIDED:
        found = [(coverage(n, share, one_side), n, share) for n in sizes for share in DISCORDANT]
        smallest, n, share = min(found)
        mean = np.mean([each for each, *_ in found])
        rows.append([one_side, smallest, mean, n, share])
    columns = ["won of differing pairs", "smallest", "mean", "at pairs", "at differing"]
    formats = {**dict.fromkeys(columns[:1] + columns[4:], ".0%"), **dict.fromkeys(columns[1:3], ".1%")}
    yield Table(
        "paired_interval",
        "How often the interval of a paired difference holds the truth",
        pd.DataFrame(rows, columns=columns),
        formats,
        f"Exact sums for {min(sizes)} to {max(sizes)} pairs, of which {100 * min(DISCORDANT):.1f} to "
        f"{100 * max(DISCORDANT):.1f} % differ. 95 % is meant.",
    )


def coverage(pairs: int, discordant: float, won: float) -> float:
    """How probably Tango's interval holds the true difference.

    Args:
        pairs: How many.
        discordant: The true share of pairs that differ.
        won: The true share of these that are won.
    """
    counts, ways, low, high = _samples(pairs)
    shares = np.array([discordant * won, discordant * (1 - won), 1 - discordant])
    truth = shares[0] - shares[1]
    holds = (low - ROUNDING <= truth) & (truth <= high + ROUNDING)
    return float(np.exp(ways + xlogy(counts, shares[:, None]).sum(0))[holds].sum())


@cache
def _samples(pairs: int) -> tuple[Array, Array, Array, Array]:
    """All counts (3, k) of pairs won, lost and alike; logarithms (k,) of their ways; bounds (k,), (k,)."""
    won, lost = np.divmod(np.arange((pairs + 1) ** 2), pairs + 1)
    counts = np.array([won, lost, pairs - won - lost], float)[:, won + lost <= pairs]
    ways = gammaln(pairs + 1) - gammaln(counts + 1).sum(0)
    return counts, ways, *score_interval(counts[0], counts[1], pairs)
