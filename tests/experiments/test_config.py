from pathlib import Path

import pytest

from experiments.loading import ConfigError, load

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.name)
def test_every_shipped_configuration_is_valid(path):
    load(path)


def test_what_is_written_is_what_is_read(suite_data, write_config):
    suite = load(write_config(suite_data))
    assert suite.scenarios[0].motions == 90
    assert suite.scenarios[0].env.world == "wild"
    assert suite.agents[1].label == "unified_servo"


def spoil(data, path, value):
    *parents, last = path
    for key in parents:
        data = data[key]
    data[last] = value


ENV = ("scenarios", 0, "env")


@pytest.mark.parametrize(
    ("path", "value", "where", "said"),
    [
        ((*ENV, "camera_mont"), "waist", "scenarios.0.env.camera_mont", "allowed: id, world, cam"),
        ((*ENV, "camera_mount"), "wrist", "scenarios.0.env.camera_mount", "allowed: waist, stand"),
        ((*ENV, "world"), "wilt", "scenarios.0.env.world", "did you mean wild?"),
        ((*ENV, "id"), "CalFree/Reach-v9", "scenarios.0.env.id", "CalFree/Reach-v0"),
        ((*ENV, "dynamics"), "magic", "scenarios.0.env.dynamics", "'physics' or 'kinematic'"),
        ((*ENV, "tolerance_px"), -1.0, "scenarios.0.env.tolerance_px", "greater than 0"),
        ((*ENV, "tolerance_px"), 900.0, "scenarios.0.env.tolerance_px", "less than 512"),
        (("scenarios", 0, "motions"), "1e6", "scenarios.0.motions", "found '1e6'"),
        (("scenarios", 0, "motions"), True, "scenarios.0.motions", "found True"),
        (("evaluation", "evry"), 5, "evaluation.evry", "allowed: every, trials"),
        (("sead",), 5, "sead", "allowed: name, question, seed"),
        (("agents", 1, "name"), "unified_serwo", "agents.1.name", "did you mean unified_servo?"),
        (("agents", 1), {"name": "random"}, "agents", "label random stands twice"),
        (("agents", 1), "random", "agents.1", "found 'random'"),
        (("agents",), [], "agents", "at least 1"),
        (
            ("scenarios", 0, "perturbations", 0, "do", "type"),
            "camera_am",
            "scenarios.0.perturbations",
            "camera_aim",
        ),
        (
            ("scenarios", 0, "perturbations", 0, "at", "motion"),
            90,
            "scenarios.0.perturbations",
            "perturbations[0] comes after 90 motions: never, in a life of 90",
        ),
        (("agents", 1, "settings"), {"tset_px": 3}, "agents.1.settings", "tset_px"),
        (("agents", 1, "settings"), {"test_px": -3.0}, "agents.1.settings", "test_px"),
        (("agents", 1, "settings"), {"seed": 3}, "agents.1.settings", "seed"),
        (("agents", 1), {"name": "sac", "settings": {"gama": 0.9}}, "agents.1.settings", "gama"),
    ],
)
def test_errors_say_where_what_and_what_else(suite_data, write_config, path, value, where, said):
    spoil(suite_data, path, value)
    config = write_config(suite_data)
    with pytest.raises(ConfigError) as error:
        load(config)
    assert str(config) in str(error.value)
    assert f"\n  {where}: " in str(error.value)
    assert said in str(error.value)


def test_one_wrong_key_is_one_error(suite_data, write_config):
    spoil(suite_data, (*ENV, "world"), "wilt")
    with pytest.raises(ConfigError) as error:
        load(write_config(suite_data))
    assert str(error.value).count("\n") == 1


def test_a_missing_key_is_named(suite_data, write_config):
    del suite_data["scenarios"][0]["motions"]
    with pytest.raises(ConfigError, match=r"scenarios\.0\.motions: missing"):
        load(write_config(suite_data))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seed: 1\nworlds: 2\nseed: 3\n", "line 1: the key 'seed' stands twice"),
        ("- 1\n", "found list"),
        ("a: [1\n", "not valid YAML"),
        ("? [1]\n: 2\n", "not valid YAML"),
    ],
)
def test_files_that_are_no_mapping(write_config, text, said):
    with pytest.raises(ConfigError, match=said):
        load(write_config(text))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: cannot be read"):
        load(tmp_path / "nowhere.yaml")


def test_settings_may_stand_in_a_file(suite_data, write_config, tmp_path):
    (tmp_path / "words.yaml").write_text("limit: 0.5\n")
    suite_data["agents"][0]["settings"] = "words.yaml"
    assert load(write_config(suite_data)).agents[0].settings == {"limit": 0.5}
