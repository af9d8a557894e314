"""The command line of studies: tables, JSON and a kept file; and first trials, which several of them make."""

import json
from types import SimpleNamespace

import gymnasium as gym
import pandas as pd
import pytest
from matplotlib.figure import Figure

import agents
from calfree_gym.tasks.reach import PRIVILEGED
from experiments import studies
from experiments.__main__ import main
from experiments.config.loading import load
from experiments.reporting.tables import Table
from experiments.running.versions import REPOSITORY
from experiments.studies.common import first_trial


@pytest.fixture
def two_studies(monkeypatch):
    def study(name):
        frame = pd.DataFrame({"agent": [name], "success": [0.5], "trials": pd.array([3])})
        table = Table(name, name.title(), frame, {"success": ".0%"})
        drawn = SimpleNamespace(figure=lambda tables: draw(tables)) if name == "priors" else SimpleNamespace()
        drawn.tables = lambda: [table]
        return drawn

    def draw(tables):
        figure = Figure()
        figure.text(0, 0, tables[0].title)
        return figure

    monkeypatch.setattr(studies, "import_module", lambda name: study(name.rpartition(".")[2]))


def test_studies_are_shown_and_kept(two_studies, tmp_path, capsys):
    out = tmp_path / "deep" / "kept.json"
    assert main(["benchmark", "priors", "insert", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "### Priors\n\n| agent | success | trials |\n| --- | --- | --- |\n| priors | 50 % | 3 |\n" in shown
    kept = json.loads(out.read_text())
    assert [table["name"] for table in kept["tables"]] == ["priors", "insert"]
    assert kept["versions"]["mujoco"]
    assert kept["commit"]
    assert [path.name for path in out.parent.glob("*.png")] == ["priors.png"], "one has a figure"
    assert main(["benchmark", "priors", "insert", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == kept
    assert main(["benchmark", "priors", "--out", str(tmp_path / "mine.json")]) == 0
    assert [path.name for path in tmp_path.glob("*.png")] == ["mine.png"], "where keep looks for it"


def test_what_is_kept_tells_the_code_that_was_loaded(two_studies, tmp_path, monkeypatch):
    made, commits = studies.measure, ["before"]
    monkeypatch.setattr(studies, "commit", lambda: commits[-1])
    monkeypatch.setattr(studies, "measure", lambda *given: (commits.append("after"), made(*given))[1])
    assert main(["benchmark", "insert", "--out", str(tmp_path / "kept.json")]) == 0
    assert json.loads((tmp_path / "kept.json").read_text())["commit"] == "before"


def test_a_figure_is_of_its_own_study(two_studies, tmp_path, monkeypatch):
    drawn = studies.import_module("priors").figure
    seen = []
    study = SimpleNamespace(figure=lambda tables: seen.extend(tables) or drawn(tables))
    study.tables = studies.import_module("priors").tables
    made = studies.import_module
    monkeypatch.setattr(studies, "import_module", lambda name: study if "priors" in name else made(name))
    assert main(["benchmark", "insert", "priors", "--out", str(tmp_path / "kept.json")]) == 0
    assert [table.name for table in seen] == ["priors"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["priors", "--out", "."], "is a folder; allowed: a file"),
        (["prior"], "no study 'prior' (did you mean priors?); allowed: changes, coverage,"),
        (["common"], "no study 'common'"),
        (["priors", "--peer", "python=Env-v0"], "--peer is timed by speed, which is none of priors"),
        (["servo"], "servo is now: python -m experiments run configs/first-trials.yaml --out FOLDER"),
    ],
)
def test_what_cannot_be_done_is_told_before_anything_is_measured(arguments, said, monkeypatch, capsys):
    monkeypatch.setattr(studies, "import_module", lambda name: pytest.fail("it was measured"))
    assert main(["benchmark", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_markdown_or_json():
    with pytest.raises(SystemExit):
        main(["benchmark", "priors", "--json", "--markdown"])


def test_each_study_has_its_tables_and_each_suite_that_was_one_is_there():
    for name in studies.names():
        assert callable(studies.import_module(f"experiments.studies.{name}").tables)
    for command in studies.MOVED.values():
        if ".yaml" in command:
            load(REPOSITORY / command.split()[1], [])


def test_who_is_told_where_to_go_is_there_after_one_motion():
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic", tell=tuple(PRIVILEGED))
    trial = first_trial(agents.make("oracle", env), env, 3)
    assert (trial.success, trial.told, trial.motions) == (True, True, 1)
    assert trial.infos[-1]["truth"]["error_px"] < 1


def test_a_trial_of_no_use_goes_on_to_the_cap():
    env = gym.make("CalFree/Grasp-v0", shape="sphere")
    trial = first_trial(agents.make("random", env), env, 3)
    assert (trial.success, trial.told, trial.motions) == (False, False, 60)
