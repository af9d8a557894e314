"""The table of arms has each on four mounts, and counts what the oracle reaches."""

import pytest

from experiments.benchmarks.arms import rendezvous
from tests.arms.own import ARMS, MOTORS


@pytest.mark.slow
def test_each_arm_stands_there_on_four_mounts(monkeypatch):
    monkeypatch.setattr(rendezvous, "SPEED_ROUNDS", 1)
    chosen = {name: ARMS[name] for name in ("gantry", "mobile")}
    table, speed = rendezvous.arms(2, chosen)
    frame = table.frame
    assert frame["arm"].tolist() == ["gantry"] * 4 + ["mobile"] * 4
    assert frame["mount"].tolist() == ["waist", "stand", "hand", "hand and stand"] * 2
    assert frame["motors"].tolist() == [len(MOTORS["gantry"])] * 4 + [len(MOTORS["mobile"])] * 4
    assert (frame["rendezvous"] == 1).all()
    assert (frame["most motions"] <= 2).all()
    assert (frame["px"] > 0).all(), "physics was compared, which never comes to rest exactly"
    assert (frame["px"] < 0.2).all()
    assert speed.frame["arm"].tolist() == ["gantry", "mobile"]
    assert (speed.frame["ratio"] > 0).all()
