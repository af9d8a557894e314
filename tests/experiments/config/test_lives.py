"""Lives of different lengths in one scenario: of an agent's own motions, with events at a share of them."""

from collections import Counter

import pytest

from experiments.config.loading import load
from experiments.running.run import parse_run, runs_of
from tests.agents.neural.quick import QUICK
from tests.experiments.fakes import AIM, ids, lived, runs

PPO = {"name": "ppo", "settings": {**QUICK["ppo"], "rows": 64}}
HALF, DECADES, CHANGE = {"share": 0.5}, {"per_decade": 1}, "scenarios.0.perturbations.0.at"


@pytest.fixture
def lives(suite_data):
    """Two agents, of which one lives longer in fewer worlds; both are perturbed in the middle."""
    suite_data["scenarios"][0]["perturbations"] = [{"at": {"share": 0.5}, "do": AIM}]
    suite_data["agents"] = ["random", {"name": "unified_servo", "motions": 400, "worlds": 1}]
    return suite_data


def test_each_agent_has_its_life_and_its_worlds(lives):
    found = runs(lives)
    made = [(run.agent.label, run.world, *run.work, run.scenario.perturbations[0]["at"]) for run in found]
    assert made == [
        ("random", 0, 90, "motions", {"motion": 45}),
        ("random", 1, 90, "motions", {"motion": 45}),
        ("unified_servo", 0, 400, "motions", {"motion": 200}),
    ]
    assert found[0].world_seed == found[2].world_seed
    assert all(parse_run(run.model_dump_json()) == run for run in found)


def test_lives_of_any_length_meet_the_same_change(lives, tmp_path):
    (shorter, *_), (longer, *_) = ([run for run in runs(lives) if run.work[0] == of] for of in (90, 400))
    changes = []
    for run in (shorter, longer):
        (folder := tmp_path / run.id).mkdir()
        changes += lived(run, folder)[0]["perturbations"]
    (first, _, one), (second, _, other) = changes
    assert (first, second) == (45, 200)
    assert one == other
    assert one["type"] == "camera_aim"


def test_a_run_does_not_tell_how_its_life_was_written(lives):
    known = {*ids(lives)}
    lives["scenarios"][0] |= {"motions": 400, "perturbations": [{"at": {"motion": 200}, "do": AIM}]}
    assert len(known & {*ids(lives, worlds=1, agents=["unified_servo", "grid_table"])}) == 1


def test_a_sweep_has_the_worlds_of_each_agent(suite_data):
    env = {"id": "CalFree/Reach-v0", "world": "nominal", "dynamics": "kinematic"}
    do = {"type": "camera_aim", "camera": "left"}
    suite_data["sweeps"] = [{"name": "aim", "env": env, "do": do, "vary": "degrees", "over": [0, 5]}]
    suite_data["agents"][1]["worlds"] = 5
    assert [len(run.world_seeds) for run in runs(suite_data)[-2:]] == [2, 5]


def test_a_scenario_has_its_worlds_and_an_agent_its_own_in_each(suite_data):
    (scenario,) = suite_data["scenarios"]
    suite_data["scenarios"].append({**scenario, "name": "long", "worlds": 2})
    suite_data["agents"][1]["worlds"] = 3
    found = runs(suite_data, worlds=4)
    amounts = Counter((run.scenario.name, run.agent.label) for run in found)
    assert [*amounts.values()] == [4, 3, 2, 3]
    seeds = {run.world: run.world_seed for run in found if run.scenario.name == "aimed"}
    assert all(seeds[run.world] == run.world_seed for run in found)
    assert len(runs(suite_data, worlds=1)) == 1 + 3 + 1 + 3
    suite_data["scenarios"][1].pop("worlds")
    assert {run.id for run in found} <= {*ids(suite_data, worlds=4)}  # how many is no part of a run


@pytest.mark.parametrize(
    ("change", "said"),
    [({"places": 2}, "counted in trials"), ({"worlds": 0}, "greater than 0"), ({"worlds": 1.5}, "integer")],
)
def test_places_and_worlds_that_cannot_be(suite_data, refused, change, said):
    suite_data["scenarios"][0] |= change
    assert said in refused(suite_data)


@pytest.mark.parametrize("share", [0, 1, -0.5, 1.5, True, "half"])
def test_a_share_is_between_0_and_1(lives, refused, share):
    lives["scenarios"][0]["perturbations"][0]["at"]["share"] = share
    said = refused(lives)
    assert "scenarios.0.perturbations.0.at.share is" in said
    assert "it must be a number between 0 and 1" in said


def test_a_life_of_trials_has_no_shares(lives, refused):
    del lives["scenarios"][0]["motions"]
    lives["scenarios"][0]["trials"] = 5
    assert "this one is counted in trials; allowed: {trial: n}" in refused(lives)
    lives["scenarios"][0]["perturbations"] = []
    assert "agents.1.motions is 400, and 'unified_servo' is in no scenario" in refused(lives)


def test_an_event_that_a_shorter_life_never_reaches_is_refused(lives, refused):
    lives["scenarios"][0]["perturbations"][0]["at"] = {"motion": 50}
    lives["agents"][1]["motions"] = 50
    said = "perturbations.0.at.motion is 50: never, in the life that 'unified_servo' has in 'aimed', of 50 mo"
    assert said in refused(lives)


def test_a_trial_that_a_life_has_not_motions_enough_for_is_refused(lives, refused):
    lives["scenarios"][0] |= {"motions": 64}
    lives["scenarios"][0]["perturbations"][0]["at"] = {"trial": 64}
    assert "perturbations.0.at.trial is 64: never, in a lifetime of 64 motions" in refused(lives)


@pytest.mark.parametrize(
    ("motions", "when", "evaluation", "where", "said"),
    [
        (240, HALF, DECADES, "agents.0.motions", "a life of 240 motions; allowed: 128 or 256"),
        (192, HALF, DECADES, CHANGE, "share 0.5 of 192 motions is motion 96; allowed: lives of 128 or 256"),
        (256, HALF, {"every": 40}, "evaluation.every", "found 40; allowed: 64"),
        (256, HALF, {"at": [0, 100]}, "evaluation.at", "found 100; allowed: 64 or 128"),
        (256, {"motion": 70}, DECADES, CHANGE, "motion 70; allowed: 64 or 128"),
        (128, {"motion": 70}, DECADES, CHANGE, "motion 70; allowed: 64"),
        (64, {"motion": 10}, DECADES, CHANGE, "motion 10; allowed: 0"),
    ],
)
def test_what_is_no_multiple_of_the_rows_is_refused_with_what_is_near(
    lives, refused, motions, when, evaluation, where, said
):
    lives["scenarios"][0] |= {"motions": 256, "perturbations": [{"at": when, "do": AIM}]}
    lives |= {"agents": [{**PPO, "motions": motions}], "evaluation": {"trials": 2, **evaluation}}
    assert f"{where}: 'ppo': its 64 arms move together: {said}" in refused(lives)


def test_what_fits_the_rows_is_taken(lives, write_config):
    lives["agents"] = [{**PPO, "motions": 256}]
    lives["evaluation"] = {"trials": 2, "per_decade": 2}
    assert runs_of(load(write_config(lives)))[0].work == (256, "motions")
