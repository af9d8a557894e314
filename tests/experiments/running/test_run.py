import math

import pytest
from pydantic import ValidationError

from experiments.running.run import parse_run
from tests.experiments.fakes import ids, runs


def test_agents_meet_the_same_worlds_and_trials(suite_data):
    seeds = {}
    for run in runs(suite_data):
        seeds.setdefault(run.world, []).append((run.world_seed, run.evaluation_seed, run.agent_seed))
    assert [(len(of_world), len(set(of_world))) for of_world in seeds.values()] == [(2, 1), (2, 1)]
    assert len({seed for of_world in seeds.values() for triple in of_world for seed in triple}) == 6


def test_more_worlds_or_agents_move_no_seed(suite_data):
    more = [*suite_data["agents"], {"name": "grid_table"}]
    assert {*ids(suite_data)} < {*ids(suite_data, worlds=5, agents=more)}


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"evaluation": {"every": 41, "trials": 2}},
        {"agents": [{"name": "random", "settings": {"a": 1}}]},
        {"scenarios": 91},
    ],
    ids=str,
)
def test_whatever_changes_a_run_changes_its_id(suite_data, change):
    if "scenarios" in change:
        change = {"scenarios": [{**suite_data["scenarios"][0], "motions": change["scenarios"]}]}
    assert ids(suite_data)[0] != ids(suite_data, **change)[0]


def test_the_order_of_settings_is_no_difference(suite_data):
    one, other = ([{"name": "random", "settings": each}] for each in ({"a": 1, "b": 2}, {"b": 2, "a": 1}))
    assert ids(suite_data, agents=one) == ids(suite_data, agents=other)


def test_scenarios_have_agents_and_evaluations_of_their_own(suite_data):
    (scenario,) = suite_data["scenarios"]
    own = {**scenario, "name": "own", "agents": ["random"], "evaluation": {"every": 30, "trials": 1}}
    found = [run for run in runs(suite_data, scenarios=[scenario, own]) if run.world == 0]
    met = [(run.scenario.name, run.agent.label, run.evaluation.every) for run in found]
    assert met == [("aimed", "random", 40), ("aimed", "unified_servo", 40), ("own", "random", 30)]


def test_who_else_takes_part_is_no_part_of_a_run(suite_data):
    few = {*ids(suite_data)}
    suite_data["scenarios"][0]["agents"] = ["random"]
    alone = {*ids(suite_data)}
    suite_data["scenarios"][0]["evaluation"] = suite_data["evaluation"]
    assert {*ids(suite_data)} == alone < few


def test_what_a_run_lacks_is_told_of_its_kind_alone(suite_data):
    written = runs(suite_data)[0].model_dump_json().replace('"name":"random"', '"name":"no_lab:random"')
    with pytest.raises(ValidationError, match="Python finds no module 'no_lab'") as error:
        parse_run(written)
    assert error.value.error_count() == 1


def test_a_run_is_read_as_it_was_written_infinite_settings_too(suite_data):
    run = runs(suite_data, agents=[{"name": "memory", "settings": {"jump_px": math.inf}}])[0]
    again = parse_run(run.model_dump_json(indent=2))
    assert (again, again.id) == (run, run.id)
    assert again.agent.settings["jump_px"] == math.inf
