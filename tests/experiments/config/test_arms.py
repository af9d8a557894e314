"""Arms in YAML: where their files are, what is wrong with them, which runs they make, and a whole suite."""

import math
import re
import shutil

import pytest
import yaml

from calfree_gym import Arm
from experiments.__main__ import main
from experiments.config.loading import load
from experiments.errors import ConfigError
from experiments.running.run import runs_of
from experiments.running.versions import REPOSITORY
from tests.arms.own import ARMS, MODELS


@pytest.fixture
def folder(tmp_path):
    """A folder as users have them: arms with their meshes beside the YAML file."""
    shutil.copytree(MODELS, tmp_path / "here" / "arms")
    return tmp_path / "here"


def suite_with(data, folder, arm, **env):
    """Writes a suite in which every scenario has an arm, and returns its path."""
    for scenario in data["scenarios"]:
        scenario["env"] |= {"arm": arm, **env}
    path = folder / "suite.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


HOBBY = {"model": "arms/hobby.xml", "gripper": "tip"}


def test_the_model_is_sought_beside_the_yaml_file_and_angles_are_degrees(suite_data, folder, monkeypatch):
    monkeypatch.chdir(folder.parent)
    degrees = {"turn": 10, "elbow": 60}
    suite = load(suite_with(suite_data, folder, {**HOBBY, "home_degrees": degrees}))
    arm = Arm.from_dict(suite.scenarios[0].env.arm)
    expected = {joint: math.radians(value) for joint, value in degrees.items()}
    assert arm == Arm(folder / "arms" / "hobby.xml", "tip", home=expected)


@pytest.mark.parametrize(
    ("arm", "said"),
    [
        ({**HOBBY, "griper": "tip"}, "an arm has no griper; allowed: model, gripper, motors, home, base"),
        ({"model": "arms/hobby.xml"}, "an arm lacks gripper"),
        ({**HOBBY, "model": "arms/hoby.xml"}, "arms/hoby.xml: there is no such MJCF file"),
        ({**HOBBY, "model": 5}, "model is 5"),
        ({**HOBBY, "gripper": "tipp"}, "did you mean tip?"),
        ({**HOBBY, "motors": "turn"}, "motors is 'turn'"),
        ({**HOBBY, "motors": 5}, "motors is 5"),
        ({**HOBBY, "motors": [[1]]}, "motors is [[1]]"),
        ({**HOBBY, "home": 5}, "home is 5"),
        ({**HOBBY, "home": {"turn": [1]}}, "home has 'turn' at [1]"),
        ({**HOBBY, "gripper": ["tip"]}, "gripper is ['tip']"),
        ({**HOBBY, "home": "up", "home_degrees": {"turn": 1}}, "the keyframe 'up', and home_degrees"),
        ({**HOBBY, "home_degrees": {"turn": "wide"}}, "home_degrees has 'turn' at 'wide'"),
        ({**HOBBY, "home_degrees": [1]}, "home_degrees is [1]"),
        ({**HOBBY, "home_degrees": {"turm": 1}}, "did you mean turn"),
        ({"model": "arms/gantry.xml", "gripper": "hook", "home_degrees": {"x": 1}}, "'x', which slides"),
        ("movemastr", "did you mean movemaster?"),
        ("mine.xml", "or for an arm of your own a mapping, such as {model: mine.xml, gripper: tip}"),
    ],
    ids=str,
)
def test_errors_name_the_place(arm, said, suite_data, folder):
    with pytest.raises(ConfigError, match=rf"scenarios\.0\.env\.arm: .*{re.escape(said)}"):
        load(suite_with(suite_data, folder, arm))


def test_an_agent_of_another_arm_is_refused_before_anything_runs(suite_data, folder):
    suite_data["agents"] = ["random", "model_based"]
    with pytest.raises(
        ConfigError, match=r"(?s)agents\.1\.settings.*'movemaster'.*allowed with any arm: random"
    ):
        load(suite_with(suite_data, folder, HOBBY))


def ids(path):
    return [run.id for run in runs_of(load(path))]


@pytest.mark.parametrize("name", ["hobby", "names"])
def test_runs_and_reports_tell_what_the_arm_is_and_not_where_its_files_are(name, suite_data, folder):
    suite_data["agents"] = ["random"]
    path = suite_with(suite_data, folder, {**ARMS[name], "model": f"arms/{name}.xml"})
    first, moved = ids(path), shutil.copytree(folder, folder.parent / "there")
    assert ids(moved / "suite.yaml") == first
    here, there = load(path), load(moved / "suite.yaml")
    assert here != there
    assert here.told() == there.told()

    model = moved / "arms" / f"{name}.xml"
    model.write_text(model.read_text().replace('mass="0', 'mass="1', 1))
    assert not set(ids(moved / "suite.yaml")) & set(first)


def test_a_changed_mesh_makes_other_runs_also_where_two_are_exchanged(suite_data, folder):
    suite_data["agents"] = ["random"]
    path = suite_with(suite_data, folder, {**ARMS["names"], "model": "arms/names.xml"})
    model, one = folder / "arms" / "names.xml", folder / "arms" / "meshes" / "wedge.stl"
    mesh = next(line for line in model.read_text().splitlines() if "wedge.stl" in line)
    model.write_text(model.read_text().replace(mesh, mesh + mesh.replace("wedge", "other")))
    was, changed = one.read_bytes(), b"x" * 80 + one.read_bytes()[80:]  # a header that says nothing
    found = []
    for contents in ((was, changed), (changed, was), (changed, changed)):
        for file, content in zip((one, one.with_name("other.stl")), contents, strict=True):
            file.write_bytes(content)
        found.append(ids(path))
    assert len({run for each in found for run in each}) == 3 * len(found[0])


@pytest.mark.slow
def test_the_documentations_suite_runs_to_the_end_and_its_report_names_the_arm(folder, capsys):
    """The example's arm has the names of our hobby arm."""
    text = (REPOSITORY / "docs/your-arm.md").read_text()
    (example,) = re.findall(r"^```yaml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    (folder / "arms" / "hobby.xml").rename(folder / "arms" / "mine.xml")
    (folder / "mine.yaml").write_text(example.replace("trials: 20", "trials: 2"))
    out = folder / "out"
    assert main(["run", str(folder / "mine.yaml"), "--out", str(out), "--set", "worlds=1"]) == 0
    report = (out / "report.md").read_text()
    digest = Arm.from_dict(load(folder / "mine.yaml").scenarios[0].env.arm).digest[:12]
    assert f"arm hobby (motors turn, shoulder, elbow; digest {digest})" in report
    assert "cameras on the turret and stand" in report
