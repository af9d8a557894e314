"""A small `python -m experiments benchmark coverage`: its table, and that intervals hold the truth."""

from dataclasses import replace

import pytest

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
