"""The parts of `benchmark controllers` against numbers known beforehand; nothing asserts what it measures."""

from dataclasses import replace

import pytest

from experiments.benchmarks.reaching import baselines, controllers
from experiments.benchmarks.trials import each_alone
from experiments.evaluation import TrialRecord

RECORD = TrialRecord(0, 1, 1.0, True, True, 1.0, 1.0, {})


def test_a_row_holds_what_is_required_beside_what_was_reached():
    """A trial that ended early without a rendezvous counts as the cap."""
    records = [replace(RECORD, motions=m, rendezvous=m < 20, success=m < 6) for m in (4, 6, 20)]
    alone = each_alone(records)
    row = {"agent": "a", **controllers._reached(alone, "waist", controllers.Required(0.99, 16))}
    table = controllers._table("first_trials", "First", [row])
    assert table.header == [
        "agent",
        "mount",
        "trials",
        "rendezvous",
        "rendezvous, 95 %",
        "required rendezvous",
        "success",
        "success, 95 %",
        "median motions",
        "required median",
        "95th percentile",
    ]
    (cells,) = table.rows
    plain = [cell for name, cell in zip(table.header, cells, strict=True) if not name.endswith(", 95 %")]
    assert plain == ["a", "waist", "3", "66.7 %", "99.0 %", "33.3 %", "6", "16", "60"]


def test_later_trials_are_drawn_with_their_world():
    """Two trials in each of 21 worlds say no more than the 21 worlds."""
    alone = each_alone([replace(RECORD, success=s) for s in (True, True, False) * 7])
    twice = [records * 2 for records in alone]
    one, other = (controllers._reached(each, "waist", controllers.Required()) for each in (alone, twice))
    assert other["trials"] == 42
    assert one["success, 95 %"] == other["success, 95 %"]


def test_a_rolled_camera_is_paired_with_the_same_trial_unrolled(monkeypatch):
    pairs = [(RECORD, replace(RECORD, motions=m)) for m in (3, 5, 9)]
    monkeypatch.setattr(controllers, "_pairs", lambda *args: iter(pairs))
    row = controllers._rolled(controllers._Timed("random", "waist"), "waist", 3)
    assert (row["agent"], row["trials"], row["median of more motions"]) == ("random", 3, 4)


def test_robustness_is_the_share_within_the_error_of_each_trouble(monkeypatch):
    records = [replace(RECORD, error_px=e) for e in (5.4, 5.6, 15.9, 16.1)]
    monkeypatch.setattr(controllers, "_first_trials", lambda *args, **options: records)
    (table,) = controllers.robust(worlds=4)
    shares = table.frame.groupby("trouble")["share"].unique()
    assert shares["20 px noise"].tolist() == [0.75]
    assert shares["40 % outliers"].tolist() == [0.25]
    required = table.frame.set_index(["trouble", "mount"])["required share"]
    assert required["20 px noise"].to_dict() == pytest.approx({"waist": 0.95, "stand": 0.85})


def test_every_controller_can_be_made_and_makes_its_trials():
    first, later, rolled = controllers.controllers(worlds=1)
    assert first.frame["trials"].tolist() == [1] * 2 * len(controllers.SERVOS)
    assert later.frame["trials"].tolist() == [3] * 2 * len(controllers.LASTING)
    assert set(rolled.frame["agent"]) == set(controllers.ROLLED)


def test_baselines_and_troubles_are_measured_of_agents_that_there_are():
    (servo,) = baselines.servo(worlds=1)
    (robust,) = controllers.robust(worlds=1)
    assert len(servo.frame) == 2
    assert set(robust.frame["agent"]) == set(controllers.LASTING)
