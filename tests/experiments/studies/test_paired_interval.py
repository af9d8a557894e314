"""The coverage of Tango's interval, by exact sums."""

import numpy as np
import pytest

from calfree_gym.perturb.paired_shares import score_interval
from experiments.studies.paired_interval import coverage, tables


def test_coverage_is_as_in_simulation():
    rng = np.random.default_rng(0)
    won, lost, _ = rng.multinomial(40, [0.05, 0.15, 0.8], 20_000).T
    low, high = score_interval(won, lost, 40)
    held = np.mean((low <= -0.1) & (high >= -0.1))
    assert held == pytest.approx(coverage(40, 0.2, 0.25), abs=0.005)


def test_the_smallest_coverage_is_near_what_is_meant():
    (table,) = tables(sizes=(30, 40, 100))
    assert table.frame["smallest"].min() > 0.94
    assert table.frame["mean"].min() > 0.945
