"""What parts of a suite ask of each other."""

import pytest

from experiments.config.loading import load
from experiments.errors import ConfigError


def test_held_out_trials_that_a_lifetime_has_no_room_for_are_refused_by_default_too(suite_data, write_config):
    short = {**suite_data, "scenarios": [{**suite_data["scenarios"][0], "trials": 1}]}
    del short["scenarios"][0]["motions"], short["evaluation"]
    with pytest.raises(ConfigError, match=r"evaluation\.every is 1000; scenario"):
        load(write_config(short))


def test_held_out_trials_of_a_scenario_are_in_one_world(suite_data, write_config):
    scenario = suite_data["scenarios"][0]
    scenario["evaluation"] = {"every": scenario["motions"], "trials": 2}
    load(write_config(suite_data))
    scenario["env"]["redraw"] = "trial"
    with pytest.raises(
        ConfigError, match=r"scenarios\.0\.evaluation: found .*: held-out trials need one world"
    ):
        load(write_config(suite_data))


def test_what_a_sweep_varies_is_a_number(suite_data, write_config):
    env = {"id": "CalFree/Reach-v0", "dynamics": "kinematic"}
    suite_data["sweeps"] = [
        {"name": "zeros", "env": env, "do": {"type": "joint_zero"}, "vary": "joint", "over": [1.0]}
    ]
    with pytest.raises(ConfigError, match=r"sweeps\.0\.vary: .*allowed: degrees$"):
        load(write_config(suite_data))
