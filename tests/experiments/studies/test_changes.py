"""Changes and right actions against numbers known beforehand; nothing asserts what they measure."""

from dataclasses import replace

import numpy as np
import pytest

from calfree_gym.perturbations.schedule import parse_schedule
from experiments.evaluation import TrialRecord
from experiments.studies import changes, right_actions

RECORD = TrialRecord(0, 1, 1.0, True, True, 1.0, 1.0, {})


def test_motions_before_and_after_changes_are_kept_apart():
    """One motion a trial; three in the first after each change, two in trials 4-8."""
    motions = np.ones(changes.TRIALS, int)
    for t in changes.CHANGES:
        motions[t] = 3
        motions[t + 3 : t + 8] = 2
    lifetimes = [[replace(RECORD, motions=int(m)) for m in motions]] * 2
    found = changes._after(lifetimes, (3, 8, 0.25), away=0)
    assert found.pop("success, 95 %") == "", "two worlds have no interval"
    before = np.mean([m for t in changes.CHANGES for m in motions[t - 50 : t]])
    assert found == pytest.approx(
        {
            "before": before,
            "1": 3,
            "4-8": 2,
            "26-50": 1,
            "required in trials": "4-8",
            "motions there": 2,
            "required": before + 0.25,
            "success": 1,
        }
    )


def test_changes_come_where_they_are_looked_for_and_the_old_camera_comes_back_there():
    for kind in changes.KINDS:
        events = parse_schedule(changes._schedule(kind))
        assert [event.at for event in events] == changes.CHANGES.tolist()
    back = parse_schedule(changes._schedule("back"))
    assert [event.at for event in back[1::2]] == changes.CHANGES.tolist()
    assert [event.at + changes.AWAY for event in back[::2]] == changes.CHANGES.tolist()
    assert [event.perturbation.event for event in back[1::2]] == [0, 2, 4, 6, 8]


@pytest.mark.slow
def test_copies_of_a_state_go_their_own_ways(monkeypatch):
    monkeypatch.setattr(right_actions, "BRANCHES", (40,))
    monkeypatch.setattr(right_actions, "AFTER", 8)
    monkeypatch.setattr(right_actions, "EVERY", ("none", "drift", "rolled", "arm changed"))
    found = right_actions._branches("waist", 3)
    assert [kind for kind, _, _ in found] == ["none", "drift", "rolled", "arm changed"]
    did, kept, _, discarded = found[0][1]
    assert did == kept < discarded
    assert min(found[2][1]) > min(found[0][1])
    assert found[2][2] == "rolled"


def test_tables_hold_what_is_required_beside_what_was_found(monkeypatch):
    monkeypatch.setattr(right_actions, "_branches", lambda mount, seed: BRANCHES)
    monkeypatch.setattr(changes, "_alarms", lambda mount, trials, seed: seed == changes.WORLDS[0])
    monkeypatch.setattr(changes, "_lifetime", lambda *args: [RECORD] * args[-2])
    actions = right_actions.right_actions(map).frame
    rolled = actions[actions["change"] == "rolled"].iloc[0]
    assert rolled[["right", "required", "did", "keep"]].tolist() == pytest.approx([0.5, 0.9, 30.5, 45.0])
    assert rolled["recognised as"] == "rolled 20, re-aimed 20"
    alarms = changes.false_alarms(map).frame
    assert alarms[["quiet trials", "false alarms", "required"]].to_numpy().tolist() == [[3000, 1, 3]] * 2
    sudden = changes.sudden_changes(map).frame
    assert len(sudden) == 36
    assert (sudden["required"] > sudden["before"]).all()
    assert changes.drift(map).frame["required"].tolist() == [1.3, 1.3]


BRANCHES = [
    (kind, ways, name)
    for kind in right_actions.EVERY
    for ways, name in (([31, 60, 30, 50], "rolled"), ([30, 30, 25, 20], "re-aimed"))
]
"""What `_branches` finds in a world: the first action is right, the second is not."""
