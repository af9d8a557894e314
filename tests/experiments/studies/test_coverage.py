"""A small `python -m experiments benchmark coverage`: its table, and that intervals hold the truth."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from calfree_gym.perturb.paired_shares import score_interval
from experiments.studies.coverage import BAD_FOR_ONE, STUDIES, tables

HARD = {"beta(99, 1)", "one in ten 30 %, others 98 %", "one in ten never", BAD_FOR_ONE}


@pytest.fixture(scope="module")
def table():
    studies = [replace(each, designs=[d for d in each.designs if d in HARD]) for each in STUDIES]
    (found,) = tables(samples=60, studies=studies, sizes=(20,), population=20_000)
    return found


def test_every_estimand_is_tried(table):
    assert set(table.frame["estimand"]) == {study.estimand for study in STUDIES}
    assert not table.frame.isna().any().any()


def test_intervals_of_20_worlds_hold_the_truth(table):
    """Of 60 samples at a coverage of 0.93, fewer than 50 hold it in one row of 250."""
    rows = table.frame.set_index(["estimand", "worlds that differ"])["20 worlds"]
    assert (rows >= 50 / 60).all(), rows[rows < 50 / 60]
    assert rows.mean() >= 0.95


@pytest.mark.parametrize("pairs", [30, 51, 100])
@pytest.mark.parametrize("won", [0.0, 0.1, 0.25, 0.5])
def test_intervals_of_paired_shares_hold_the_truth_in_all_outcomes_added_up(pairs, won):
    """docs/statistics.md tells of the smallest coverage."""
    wins, losses = np.divmod(np.arange((pairs + 1) ** 2), pairs + 1)
    counts = np.stack([wins, losses, pairs - wins - losses], axis=-1)[wins + losses <= pairs]
    low, high = score_interval(counts[:, 0], counts[:, 1], pairs)
    for differing in (0.005, 0.05, 0.25, 0.5, 0.975):
        truth = differing * (2 * won - 1)
        shares = [differing * won, differing * (1 - won), 1 - differing]
        held = (low - 1e-12 <= truth) & (truth <= high + 1e-12)
        assert scipy.stats.multinomial.pmf(counts[held], pairs, shares).sum() > 0.95
