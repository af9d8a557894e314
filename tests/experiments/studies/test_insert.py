"""The benchmark of inserting: a row for each agent, clearance and mount."""

import pytest

from experiments.studies.insert import tables


@pytest.mark.slow
def test_a_row_for_each_agent_clearance_and_mount():
    (table,) = tables(worlds=2, clearances=(2.0, 3.0))
    found = table.frame
    assert found["agent"].tolist() == ["insert"] * 3 + ["yoshimi_allen"] * 3
    assert found["mount"].tolist() == ["waist", "waist", "stand"] * 2
    assert found["required"].notna().tolist() == [True, False, True] * 2
    assert (found["motions"] <= 60).all()
    assert found["success"].between(0, 1).all()
