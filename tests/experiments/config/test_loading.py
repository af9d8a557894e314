import re

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.__main__ import main
from experiments.config.loading import load, read_yaml
from experiments.errors import ConfigError
from experiments.running.versions import REPOSITORY
from tests.experiments.conftest import tiny_suite
from tests.experiments.fakes import DROPPED, spoil

CONFIGS = REPOSITORY / "configs"
SUITES = sorted(path for path in CONFIGS.glob("*.yaml") if "\nquestion:" in path.read_text())


@pytest.mark.parametrize("path", SUITES, ids=lambda path: path.name)
def test_every_shipped_configuration_is_valid(path):
    fetched = re.findall(r"\.\./build/arms/[^,}\s]+", path.read_text())
    if not all((CONFIGS / model).is_file() for model in fetched):
        pytest.skip("`make arms` has not fetched its arms")
    load(path)


ENV = ("scenarios", 0, "env")
GRASP = {"id": "CalFree/Grasp-v0", "world": "wild", "shape": "bar"}
(AIMED,) = tiny_suite()["scenarios"]
CHANGE, EVERY = ("scenarios", 0, "perturbations", 0), {"every": 90, "trials": 2}
TAKEN = [AIMED, AIMED | {"name": "aimed-held-out"}]
REDRAWN = AIMED | {"evaluation": EVERY, "env": AIMED["env"] | {"redraw": "trial"}}


@pytest.mark.parametrize(
    ("path", "value", "where", "said"),
    [
        ((*ENV, "camera_mont"), "waist", "scenarios.0.env.camera_mont", "allowed: id, world, arm, cam"),
        ((*ENV, "camera_mount"), "wrist", "scenarios.0.env.camera_mount", "allowed: waist, stand"),
        ((*ENV, "world"), "wilt", "scenarios.0.env.world", "did you mean wild or wilder?"),
        ((*ENV, "id"), "CalFree/Reach-v9", "scenarios.0.env.id", "CalFree/Reach-v0"),
        ((*ENV, "shape"), "bar", "scenarios.0.env", "shape is of grasping"),
        ((*ENV, "id"), "CalFree/Grasp-v0", "scenarios.0.env", "dynamics is of reaching"),
        ((*ENV, "clearance"), 1.0, "scenarios.0.env", "clearance is of inserting"),
        ((*ENV, "orientation"), "any", "scenarios.0.env", "orientation is of grasping"),
        ((*ENV, "dynamics"), "magic", "scenarios.0.env.dynamics", "'physics' or 'kinematic'"),
        ((*ENV, "tolerance_px"), -1.0, "scenarios.0.env.tolerance_px", "greater than 0"),
        ((*ENV, "tolerance_px"), 900.0, "scenarios.0.env.tolerance_px", "less than 256"),
        (("scenarios", 0, "motions"), "1e6", "scenarios.0.motions", "found '1e6'"),
        (("scenarios", 0, "motions"), True, "scenarios.0.motions", "found True"),
        ((*ENV, "redraw"), "trial", "evaluation", "held-out trials need one world a lifetime"),
        (
            ("evaluation", "evry"),
            5,
            "evaluation.evry",
            "mean every?); allowed: trials, every, at, per_decade",
        ),
        (("sead",), 5, "sead", "allowed: name, question, seed"),
        (("extend",), "other.yaml", "extend", "did you mean extends or seed"),
        (("agents", 1, "name"), "unified_serwo", "agents.1.name", "did you mean unified_servo"),
        (("agents", 1), {"name": "random"}, "agents", "label random stands twice"),
        (("agents", 1), 7, "agents.1", "found 7: it must be a name or a mapping"),
        (("agents",), [None], "agents.0", "found None: it must be a name or a mapping"),
        (("agents",), "memory", "agents", "found 'memory': it must be a list"),
        (("scenarios",), "aimed", "scenarios", "found 'aimed': it must be a list"),
        (("scenarios", 0), None, "scenarios.0", "found None: it must be a mapping"),
        (("agents", 1), "randm", "agents.1.name", "did you mean random?"),
        (("evaluation", "every"), 91, "evaluation.every is 91", "scenario 'aimed' has 90 motions"),
        ((*ENV, "tell"), ["joint_angles"], "scenarios.0.env.tell: unknown key", "allowed: id, world"),
        (("scenarios",), [], "sweeps: found ()", "neither scenarios nor sweeps are given"),
        (("scenarios",), TAKEN, "sweeps", "a figure of 'aimed' is called"),
        (("scenarios", 0, "name"), DROPPED, "scenarios.0.name: missing", ""),
        (("scenarios", 0, "agents"), ["unified_serwo"], "agents", "did you mean unified_servo"),
        (("scenarios", 0, "evaluation"), EVERY | {"every": 91}, "scenarios.0.evaluation.every is 91", ""),
        (("scenarios", 0), REDRAWN, "scenarios.0.evaluation: found", "held-out trials need one world"),
        (ENV, GRASP, "agents: found", "'unified_servo' cannot grasp, as 'aimed' asks; allowed: random, gr"),
        (ENV, GRASP | {"shape": "ball"}, "scenarios.0.env.shape", "'ball'"),
        (ENV, {"id": "CalFree/Insert-v0", "world": "wild"}, "agents: found", "'unified_servo' cannot insert"),
        ((*ENV, "pool"), 8, "scenarios.0.env", "pool is 8, so redraw must be 'trial'; it is 'never'"),
        ((*ENV, "pool"), 0, "scenarios.0.env.pool", "greater than 0"),
        ((*ENV, "redraw"), "always", "scenarios.0.env.redraw", "'never' or 'trial'"),
        (("agents",), [], "agents", "at least 1"),
        (
            (*CHANGE, "do", "type"),
            "camera_am",
            "scenarios.0.perturbations.0.do.type is 'camera_am' (did you mean camera_aim",
            "camera_roll",
        ),
        (
            (*CHANGE, "do", "camera"),
            "lft",
            "scenarios.0.env: camera_aim.camera is 'lft' (did you mean left?)",
            "allowed: left, right",
        ),
        (
            (*CHANGE, "at", "motion"),
            90,
            "scenarios.0.perturbations.0.at.motion is 90",
            "a lifetime of 90 motions",
        ),
        (("agents", 1, "settings"), {"tset_px": 3}, "agents.1.settings", "tset_px"),
        (("agents", 1, "settings"), {"test_px": -3.0}, "agents.1.settings", "test_px"),
        (("agents", 1, "settings"), {"seed": 3}, "agents.1.settings", "seeds are drawn from the suite"),
        (("agents", 1), {"name": "sac", "settings": {"gama": 0.9}}, "agents.1.settings", "gama"),
    ],
)
def test_errors_say_where_what_and_what_else(suite_data, refused, path, value, where, said):
    spoil(suite_data, path, value)
    found = refused(suite_data)
    assert "suite.yaml:\n" in found
    assert f"\n  {where}" in found
    assert said in found


def test_one_wrong_key_is_one_error(suite_data, refused):
    spoil(suite_data, (*ENV, "world"), "wilt")
    assert refused(suite_data).count("\n") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seed: 1\nworlds: 2\nseed: 3\n", "suite.yaml, line 1, column 1: .*the key 'seed' stands twice"),
        ("- 1\n", "found list"),
        (
            "a: [1\n",
            r"line 2, column 1: is not valid YAML: .*flow sequence that begins in line 1, column 4",
        ),
        ("a: 1\nb: 2\n  c: 3\n", "suite.yaml, line 3, column 4: is not valid YAML"),
        ("? [1]\n: 2\n", "not valid YAML"),
        ("a: \x07", "not valid YAML"),
        ("a: 2020-13-45\n", "suite.yaml: is not valid YAML: month"),
        ("[" * 3000, "suite.yaml: is not valid YAML: .*nested too deeply"),
        ("a: {b: 010}", r"suite.yaml:\n  a.b: found 010, which YAML takes for 8; allowed: decimal"),
    ],
)
def test_files_that_are_no_mapping(refused, text, said):
    assert re.search(said, refused(text))


def test_a_mapping_may_take_over_the_keys_of_another(tmp_path):
    (tmp_path / "merged.yaml").write_text("one: &one {a: 1, b: 2}\ntwo:\n  <<: *one\n  b: 3\n")
    assert read_yaml(tmp_path / "merged.yaml")["two"] == {"a": 1, "b": 3}


def test_overrides_are_read_as_yaml_and_name_other_files(suite_data, write_config, tmp_path):
    (tmp_path / "words.yaml").write_text("limit: 0.5\n")
    overrides = [
        "worlds=5",
        "scenarios.0.motions=200",
        "agents.0.settings=words.yaml",
        "agents.1.settings={}",
    ]
    suite = load(write_config(suite_data), overrides)
    assert (suite.worlds, suite.scenarios[0].motions) == (5, 200)
    assert suite.agents[0].settings == {"limit": 0.5}


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("world=5", "world: unknown key (did you mean worlds or first_world?)"),
        ("worlds=two", "worlds: found 'two'"),
        ("worlds", "found no key=value"),
        ("agents.7.name=random", "found '7'; allowed: 0 to 1"),
        ("worlds.0=1", "leads into 2, which has no keys"),
        ("worlds=[", "the value is not valid YAML"),
        ("worlds=2020-13-45", "the value is not valid YAML: month"),
        ("worlds=010", "--set worlds=010: found 010, which YAML takes for 8; allowed: decimal"),
        ("scenarios.0={motions: 1:30}", "motions: found 1:30, which YAML takes for 90"),
        ("agents.0.settings=unclear.yaml", "unclear.yaml:\n  limit: found '5e-1', which YAML takes for text"),
        ("agents.0.settings=torn.yaml", "torn.yaml, line 2, column 1: is not valid YAML"),
        ("agents.0.settings=text.yaml", "text.yaml: found text; allowed: a mapping of settings"),
        ("agents.0.settings=/dev/zero", "/dev/zero: cannot be read; allowed: a file of at most"),
        ("world\x1b[31m=5", "world\ufffd[31m: unknown key"),
        ("claims=claims.yaml", "claims.yaml:\n  0.criteria.0.above: found 0x1F"),
    ],
)
def test_wrong_overrides_are_answered_like_the_file(suite_data, refused, tmp_path, override, said):
    (tmp_path / "unclear.yaml").write_text("limit: 5e-1")
    (tmp_path / "text.yaml").write_text("/etc/hostname")
    (tmp_path / "torn.yaml").write_text("limit: 0.5\n- 1\n")
    (tmp_path / "claims.yaml").write_text("- {name: a, criteria: [{above: 0x1F}]}")
    assert said in refused(suite_data, override)


def leaves(value, path=()):
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, (*path, key))
    else:
        yield path


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_damage_gets_an_error_that_names_its_place(suite_data, refused, data):
    """A key dropped, misspelled or given a value of a kind that it never has."""
    paths = [path for path in leaves(suite_data) if path[-1] not in OPTIONAL]
    path = data.draw(st.sampled_from(paths))
    spoiled = yaml.safe_load(yaml.safe_dump(suite_data))
    *parents, last = path
    damage = data.draw(st.sampled_from([DROPPED, "misspelt", [[1]], None, {"a": 1}]))
    if damage == "misspelt":
        spoil(spoiled, (*parents, f"{last}x"), 1)
        damage = DROPPED
    spoil(spoiled, path, damage)
    first, *wrong = refused(spoiled).splitlines()
    assert "suite.yaml:" in first
    named = ".".join(map(str, path))
    within = ".".join(map(str, parents))
    assert any(named in line or (within and line.strip().startswith(within)) for line in wrong)


OPTIONAL = {"seed", "camera_mount", "tolerance_px", "dynamics", "max_episode_steps", "camera", "degrees"}
"""Keys that may be left out of a configuration, or drawn."""


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(1, 500))
def test_a_file_that_was_cut_off_is_answered_in_one_message(suite_data, write_config, cut):
    text = yaml.safe_dump(suite_data)
    config = write_config(text[: len(text) - min(cut, len(text) - 1)])
    said = str(config)
    try:
        load(config)
    except ConfigError as error:
        said = str(error)
    assert said.startswith(str(config))


def test_a_file_takes_what_it_has_not_from_the_one_that_it_extends(suite_data, write_config, tmp_path):
    write_config(suite_data)
    (tmp_path / "more.yaml").write_text("extends: suite.yaml\nworlds: 7\n")
    of_both = load(tmp_path / "more.yaml")
    assert of_both.worlds == 7
    assert of_both.model_copy(update={"worlds": 2}) == load(tmp_path / "suite.yaml")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere.yaml", r"nowhere\.yaml: cannot be read"),
        ("a" * 300, "cannot be read: .*File name too long"),
        ("more.yaml", r"extends: found a circle, more\.yaml -> more\.yaml"),
        ("other.yaml", r"third\.yaml: extends: found a circle, more.* -> other.* -> third.* -> other\.yaml"),
        ("../suite.yaml", "allowed: the name of a file beside this one"),
        (3, "found 3"),
    ],
)
def test_a_file_that_cannot_be_extended_is_told(tmp_path, name, said):
    (tmp_path / "more.yaml").write_text(yaml.safe_dump({"extends": name, "worlds": 7}))
    (tmp_path / "other.yaml").write_text("extends: third.yaml")
    (tmp_path / "third.yaml").write_text("extends: other.yaml")
    with pytest.raises(ConfigError, match=said):
        load(tmp_path / "more.yaml")


@pytest.mark.parametrize(
    ("command", "name", "said"),
    [
        ("validate", "film.yaml", "holds what is filmed, which the command film takes"),
        ("validate", "tuning.yaml", "holds what is tuned, which the command tune takes"),
        ("run", "claims.yaml", "holds claims, which a suite names under its key claims"),
        ("film", "quick.yaml", "holds a suite, which the commands run and validate take"),
        ("tune", "quick.yaml", "holds a suite, which the commands run and validate take"),
        ("tune", "film.yaml", "holds what is filmed, which the command film takes"),
    ],
)
def test_a_file_of_another_kind_is_one_message(command, name, said, tmp_path, capsys):
    out = [] if command == "validate" else ["--out", str(tmp_path / "out")]
    assert main([command, str(CONFIGS / name), *out]) == 2
    assert capsys.readouterr().err == f"error: {CONFIGS / name}: {said}\n"
