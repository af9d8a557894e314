"""FetchReach with a camera turned, where gymnasium-robotics is installed; and how it is drawn."""

import pandas as pd
import pytest

from experiments.reporting.tables import Table
from experiments.studies.knocked import figure, tables


@pytest.mark.slow
def test_who_is_calibrated_fails_and_who_looks_does_not():
    pytest.importorskip("gymnasium_robotics")
    shares, pairs = tables(episodes=4, policies=("calibrated", "unified_servo"))
    found = shares.frame.set_index("camera turned by")
    assert found["calibrated"].tolist() == [0.75, 0, 0, 0, 0]  # one goal lies in the table
    assert found["unified_servo"].tolist() == [0.75] * 5
    assert len(pairs.frame) == 8


def test_each_policy_has_a_bar_for_each_change():
    frame = pd.DataFrame({"camera turned by": ["as built", "5°"], "one": [1.0, 0.5], "two": [0.9, 0.9]})
    (axes,) = figure([Table("knocked", "", frame)]).axes
    assert sorted(bar.get_height() for bar in axes.patches) == [50, 90, 90, 100]
