"""Agents and arms side by side, from results that may have been made elsewhere."""

import shutil

import pandas as pd
import pytest
import yaml

from experiments.__main__ import main
from experiments.reporting import by_trial
from experiments.reporting.by_trial import many_arms, own_trials
from experiments.reporting.results_file import RESULTS, read_finished
from tests.arms.own import MODELS


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Results with the built-in arm and with one whose file is gone by now."""
    folder = tmp_path_factory.mktemp("arms")
    shutil.copy(MODELS / "gantry.xml", folder / "mine.xml")
    env = {"id": "CalFree/Reach-v0", "world": "wild", "camera_mount": "stand", "dynamics": "kinematic"}
    arms = {"built-in": {}, "mine": {"arm": {"model": "mine.xml", "gripper": "hook"}}}
    scenarios = [{"name": name, "env": env | arm, "trials": 3} for name, arm in arms.items()]
    suite = {"name": "arms", "question": "Any?", "worlds": 2, "scenarios": scenarios, "evaluation": None}
    (folder / "suite.yaml").write_text(yaml.safe_dump(suite | {"agents": ["oracle", "random"]}))
    out = folder / "out"
    assert main(["run", str(folder / "suite.yaml"), "--out", str(out), "--jobs", "2"]) == 0
    (folder / "mine.xml").unlink()
    return out


def test_results_say_what_an_arm_is_and_no_folder(out, tmp_path):
    shutil.copy(out / RESULTS, tmp_path)
    finished = read_finished(tmp_path / RESULTS, tmp_path)
    _, mine = finished.suite.scenarios
    assert mine.env.arm["motors"] == ["x", "y", "z"]
    assert mine.env.arm["model"] == "gantry"
    assert str(out.parent) not in str(finished.suite.model_dump())
    assert str(out.parent) not in (out / "report.md").read_text()


def test_the_report_has_one_table_of_arms_whose_numbers_are_those_of_the_trials(out):
    _, _, table = (out / "report.md").read_text().partition("<summary>Agents by arms</summary>")
    assert "| arm | agent | trial 1 | trials 2–3 | rendezvous |" in table
    assert "| built-in | oracle | 1.0 | 1.0 | 100.0 % |" in table
    rows = pd.read_parquet(out / RESULTS)
    mine = rows[(rows["scenario"] == "mine") & (rows["agent"] == "random")]
    motions = mine["motions"].where(mine["rendezvous"] == 1, 60)
    of_world = motions.groupby([mine["world"], mine["trial"] > 0]).mean().unstack().median()
    share = f"{mine['rendezvous'].mean():.1%}".replace("%", " %")
    assert f"| mine | random | {of_world[False]:.1f} | {of_world[True]:.1f} | {share} |" in table
    assert (out / "figures" / "arms.png").exists()
    assert "trial by trial" not in (out / "report.md").read_text()


def test_the_figure_has_a_point_for_each_arm_and_agent_which_is_the_median_world(out, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(by_trial, "save", lambda figure, *_: drawn.append(figure))
    finished = read_finished(out / RESULTS, tmp_path)
    by_trial.arms_sections(finished, [own_trials(finished, each) for each in finished.suite.scenarios])
    first, _ = drawn[0].axes
    points = {line.get_label(): list(line.get_xdata()) for line in first.lines}
    rows = pd.read_parquet(out / RESULTS)
    mine = rows[(rows["agent"] == "random") & (rows["trial"] == 0)]
    motions = mine["motions"].where(mine["rendezvous"] == 1, 60)
    medians = motions.groupby(mine["scenario"]).median()
    arms = [text.get_text().partition(" (")[0] for text in first.get_yticklabels()]
    assert points["random motions"] == [medians[arm] for arm in arms]
    assert "Points: the median world." in drawn[0].get_supxlabel()


def test_only_steady_scenarios_with_several_arms_are_set_side_by_side(out):
    scenarios = read_finished(out / RESULTS, out).suite.scenarios
    assert many_arms(scenarios)
    assert not many_arms(scenarios[:1])
    assert not many_arms(())
    aimed = scenarios[1].model_copy(update={"perturbations": ({"at": {"trial": 1}},)})
    assert not many_arms((scenarios[0], aimed))
    for other in ({"agents": ("random",)}, {"trials": 99}, {"worlds": 99}):
        assert not many_arms((scenarios[0], scenarios[1].model_copy(update=other)))
