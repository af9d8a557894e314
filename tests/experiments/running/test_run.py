import math

from experiments.config.suite import Suite
from experiments.running.run import parse_run, runs_of


def test_agents_meet_the_same_worlds_and_trials(suite_data):
    runs = runs_of(Suite.model_validate(suite_data))
    assert len(runs) == 4
    seeds = {}
    for run in runs:
        seeds.setdefault(run.world, set()).add((run.world_seed, run.evaluation_seed, run.agent_seed))
    assert all(len(of_world) == 1 for of_world in seeds.values())
    assert len({seed for of_world in seeds.values() for triple in of_world for seed in triple}) == 6


def test_more_worlds_or_agents_move_no_seed(suite_data):
    few = runs_of(Suite.model_validate(suite_data))
    suite_data["worlds"] = 5
    suite_data["agents"].append({"name": "grid_table"})
    assert {run.id for run in few} < {run.id for run in runs_of(Suite.model_validate(suite_data))}


def test_whatever_changes_a_run_changes_its_id(suite_data):
    ids = {runs_of(Suite.model_validate(suite_data))[0].id}
    for change in (
        {"seed": 2},
        {"evaluation": {"every": 41, "trials": 2}},
        {"agents": [{"name": "random", "settings": {"a": 1}}]},
        {"scenarios": [{**suite_data["scenarios"][0], "motions": 91}]},
    ):
        ids.add(runs_of(Suite.model_validate(suite_data | change))[0].id)
    assert len(ids) == 5


def test_the_order_of_settings_is_no_difference(suite_data):
    suite_data["agents"] = [{"name": "random", "settings": {"a": 1, "b": 2}}]
    one = runs_of(Suite.model_validate(suite_data))
    suite_data["agents"] = [{"name": "random", "settings": {"b": 2, "a": 1}}]
    assert [run.id for run in one] == [run.id for run in runs_of(Suite.model_validate(suite_data))]


def test_scenarios_have_agents_and_evaluations_of_their_own(suite_data):
    (scenario,) = suite_data["scenarios"]
    own = {**scenario, "name": "own", "agents": ["random"], "evaluation": {"every": 30, "trials": 1}}
    suite_data["scenarios"].append(own)
    runs = runs_of(Suite.model_validate(suite_data))
    met = [(run.scenario.name, run.agent.label, run.evaluation.every) for run in runs if run.world == 0]
    assert met == [("aimed", "random", 40), ("aimed", "unified_servo", 40), ("own", "random", 30)]


def test_who_else_takes_part_is_no_part_of_a_run(suite_data):
    few = {run.id for run in runs_of(Suite.model_validate(suite_data))}
    suite_data["scenarios"][0]["agents"] = ["random"]
    alone = {run.id for run in runs_of(Suite.model_validate(suite_data))}
    suite_data["scenarios"][0]["evaluation"] = suite_data["evaluation"]
    assert {run.id for run in runs_of(Suite.model_validate(suite_data))} == alone < few


def test_a_run_is_read_as_it_was_written_infinite_settings_too(suite_data):
    suite_data["agents"] = [{"name": "memory", "settings": {"jump_px": math.inf}}]
    run = runs_of(Suite.model_validate(suite_data))[0]
    again = parse_run(run.model_dump_json(indent=2))
    assert (again, again.id) == (run, run.id)
    assert again.agent.settings["jump_px"] == math.inf
