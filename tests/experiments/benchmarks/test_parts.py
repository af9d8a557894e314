"""The benchmark's command line: every part, as tables, JSON and a kept file."""

import json

import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.benchmarks import parts
from experiments.reporting.tables import Table


@pytest.fixture
def two_parts(monkeypatch):
    def made(name):
        frame = pd.DataFrame({"agent": [name], "success": [0.5], "trials": pd.array([3])})
        yield Table(name, name.title(), frame, {"success": ".0%"})

    for name in ("robust", "sac"):
        monkeypatch.setitem(parts.PARTS, name, lambda name=name: made(name))


def test_parts_are_shown_and_kept(two_parts, tmp_path, capsys):
    out = tmp_path / "deep" / "kept.json"
    assert main(["benchmark", "robust", "sac", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "### Robust\n\n| agent | success | trials |\n| --- | --- | --- |\n| robust | 50 % | 3 |\n" in shown
    kept = json.loads(out.read_text())
    assert [table["name"] for table in kept["tables"]] == ["robust", "sac"]
    assert kept["versions"]["mujoco"]
    assert kept["commit"]
    assert main(["benchmark", "robust", "sac", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == kept


def test_a_folder_is_refused_before_anything_is_measured(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(parts.PARTS, "robust", lambda: pytest.fail("it was measured"))
    assert main(["benchmark", "robust", "--out", str(tmp_path)]) == 2
    assert "is a folder; allowed: a file" in capsys.readouterr().err


def test_markdown_or_json():
    with pytest.raises(SystemExit):
        main(["benchmark", "robust", "--json", "--markdown"])
