"""Ranges are checked before anything is tried, and no world is that of a suite."""

import gymnasium
import pytest
import yaml

from experiments.config.loading import read_mapping, read_yaml
from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.running.run import runs_of
from experiments.running.versions import REPOSITORY
from experiments.tuning.config import load_tuning, seeds_of_suites
from tests.experiments.fakes import spoil

CONFIGS = REPOSITORY / "configs"
RANGE = ("agents", 0, "ranges", "damping")


@pytest.fixture(scope="module")
def shipped():
    return load_tuning(CONFIGS / "tuning.yaml")


@pytest.mark.parametrize(
    ("path", "value", "where", "said"),
    [
        (("agents", 0, "name"), "jacobian_serwo", "agents.0.name", "did you mean jacobian_servo"),
        (("agents", 0, "scenario"), "amed", "agents.0.scenario: found 'amed'", "did you mean aimed"),
        (("agents", 0, "ranges"), {"dampin": {"low": 0.1, "high": 1.0}}, "agents.0.ranges.dampin", "damping"),
        ((*RANGE, "high"), 0.0001, "agents.0.ranges.damping.high: found 0.0001", "above low, 0.001"),
        ((*RANGE, "high"), "1", "agents.0.ranges.damping.high: found '1'", "a finite number"),
        ((*RANGE, "hihg"), 1.0, "agents.0.ranges.damping.hihg: unknown key", "mean high?); allowed: low"),
        ((*RANGE, "low"), 0.0, "agents.0.ranges.damping.log", "only positive numbers have logarithms"),
        ((*RANGE, "low"), 0.06, "agents.0.ranges.damping", "the default 0.05 is no number from 0.06 to 1"),
        (RANGE, {"low": -1.0, "high": 1.0}, "agents.0.ranges.damping.low: found -1.0", "damping"),
        (RANGE, {"low": 0, "high": 1}, "agents.0.ranges.damping", "the default 0.05 is no whole number"),
        (("agents", 0, "ranges"), {}, "agents.0.choices", "neither ranges nor choices"),
        (("agents", 0, "choices"), {"damping": [1, 2]}, "agents.0.choices.damping", "ranges has it too"),
        (("agents", 0, "choices"), {"estimator": ["rls"]}, "agents.0.choices.estimator", "two or more"),
        (("agents", 0, "choices"), {"estimator": ["rls", "local"]}, "agents.0.choices.estimator", "'kalman'"),
        (("agents", 0, "choices"), {"estimator": ["kalman", "x"]}, "agents.0.choices.estimator.1", "rls"),
        (("agents", 0, "settings"), {"damping": 0.1}, "agents.0.choices", "settings gives damping already"),
        (("agents", 0, "settings"), {"dampin": 0.1}, "agents.0.settings", "did you mean damping"),
        (("agents", 0, "settings"), {"seed": 3}, "agents.0.settings", "seeds are drawn"),
        (("agents",), [], "agents", "at least 1"),
        (("tries",), 0, "tries", "greater than 0"),
        (("cpu_minute",), 3, "cpu_minute: unknown key (did you mean cpu_minutes?)", "allowed: seed, tries"),
        (("scenarios", 0, "agents"), ["sac"], "scenarios.0.agents", "each agent names its scenario"),
        (("scenarios", 0, "worlds"), 0, "scenarios.0.worlds", "greater than 0"),
        (("scenarios", 0, "evaluation", "every"), 91, "scenarios.0.evaluation.every is 91", "at most 90"),
        (("scenarios", 0, "evaluation"), {"at": [91], "trials": 2}, "scenarios.0.evaluation.at", "most 90"),
        (("scenarios", 0, "perturbations", 0, "at"), {"motion": 90}, "scenarios.0.perturbations.0", "never"),
    ],
)
def test_errors_say_where_what_and_what_else(tuning_data, refused, path, value, where, said):
    spoil(tuning_data, path, value)
    found = refused(tuning_data, load=load_tuning)
    assert f"\n  {where}" in found
    assert said in found
    assert found.count("\n") == 1


def test_a_seed_is_not_varied(tuning_data, refused):
    tuning_data["agents"][0]["ranges"] = {"seed": {"low": 0, "high": 9}}
    assert "agents.0.ranges.seed.high: found 9: seeds are drawn" in refused(tuning_data, load=load_tuning)


def test_sizes_that_are_tuples_by_default_are_lists_in_yaml(tuning_data, write_config):
    sizes = {"hidden": [[32, 32], [64, 64]]}
    tuning_data["agents"] = [{"name": "self_supervised", "scenario": "aimed", "choices": sizes}]
    (agent,) = load_tuning(write_config(tuning_data)).agents
    assert agent.defaults() in [{"hidden": size} for size in sizes["hidden"]]


def test_worlds_of_a_suite_beside_it_are_refused(tuning_data, suite_data, write_config, tmp_path):
    config = write_config(tuning_data)
    (tmp_path / "quick.yaml").write_text(yaml.safe_dump(suite_data | {"seed": 7, "worlds": 1}))
    with pytest.raises(ConfigError, match=r"seed: found 7: it gives worlds of quick\.yaml"):
        load_tuning(config)
    load_tuning(config, ["seed=8"])


def test_no_world_of_tuning_is_that_of_a_suite(shipped):
    def world(seed):
        env.reset(seed=seed)
        return env.unwrapped.world.camera_position.tobytes()

    somewhere = {"name": "s", "env": shipped.scenarios[0].env.model_dump(), "motions": 1000}
    tested = set()
    suites = [path for path in sorted(CONFIGS.glob("*.yaml")) if isinstance(read_yaml(path), dict)]
    for data in map(read_mapping, suites):
        if "worlds" in data:
            size = {key: data[key] for key in ("seed", "first_world", "worlds") if key in data}
            plain = {"name": "s", "question": "", "scenarios": [somewhere], "agents": ["random"]}
            tested |= {run.world_seed for run in runs_of(Suite.model_validate(plain | size))}
    assert len(tested) >= 100
    assert tested == seeds_of_suites(CONFIGS).keys()
    seeds = set()
    for agent in shipped.agents:
        own = [run.world_seed for run in runs_of(shipped.suite(agent, agent.defaults()))]
        assert len(set(own)) == len(own)  # so none is one of tries and of the check
        seeds |= set(own)
    assert not seeds & tested
    env = gymnasium.make("CalFree/Reach-v0", world="wild", dynamics="kinematic")
    assert not {world(seed) for seed in seeds} & {world(seed) for seed in tested}


def test_all_agents_are_tuned_alike(shipped):
    assert (shipped.tries, shipped.cpu_minutes) == (20, 20)
    for agent in shipped.agents:
        scenario = shipped.scenario_of(agent)
        assert 2 <= len(agent.ranges) + len(agent.choices) <= 5
        assert [event["do"]["type"] for event in scenario.perturbations] == ["camera_aim"]
        assert scenario.env == shipped.scenarios[0].env
