"""The parts of `benchmark changes` against numbers known beforehand; nothing asserts what it measures."""

from dataclasses import replace

import numpy as np

from calfree_gym.perturbations.schedule import parse_schedule
from experiments.benchmarks import changes as changing
from experiments.evaluation import TrialRecord

RECORD = TrialRecord(0, 1, 1.0, True, 1.0, 1.0, {})


def test_motions_before_and_after_changes_are_told_apart():
    """One motion a trial; three in the first after each change, two in trials 4-8."""
    motions = np.ones(changing._STRUCK, int)
    for t in changing._CHANGES:
        motions[t] = 3
        motions[t + 3 : t + 8] = 2
    lives = [[replace(RECORD, motions=int(m)) for m in motions]] * 2
    told = changing._after(lives, (3, 8, 0.25), away=0)
    later = [m for t in changing._CHANGES for m in motions[t - 50 : t]]
    assert told.startswith(f"before: {np.mean(later):.2f}   1-1:  3.00   4-8:  2.00")
    assert f"({np.mean(later) + 0.25:.2f})" in told
    assert told.endswith("success 100.00%")


def test_five_changes_strike_where_they_are_looked_for_and_the_old_camera_comes_back_there():
    for kind in changing.KINDS:
        events = parse_schedule(changing._schedule(kind))
        assert [event.at for event in events] == changing._CHANGES.tolist()
    back = parse_schedule(changing._schedule("back"))
    assert [event.at for event in back[1::2]] == changing._CHANGES.tolist()
    assert [event.at + changing.AWAY for event in back[::2]] == changing._CHANGES.tolist()
    assert [event.perturbation.event for event in back[1::2]] == [0, 2, 4, 6, 8]


def test_copies_of_a_state_go_their_own_ways_and_are_told_apart(monkeypatch):
    monkeypatch.setattr(changing, "BRANCHES", (40,))
    monkeypatch.setattr(changing, "AFTER", 8)
    monkeypatch.setattr(changing, "KINDS", {"rolled": "camera_roll"})
    found = changing._branches(3, "waist")
    assert [kind for kind, _, _ in found] == ["none", "drift", "rolled", "arm changed"]
    did, kept, _, discarded = found[0][1]
    assert did == kept < discarded
    assert min(found[2][1]) > min(found[0][1])
    assert found[2][2] == "rolled"
