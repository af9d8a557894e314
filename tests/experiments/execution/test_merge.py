"""Parts of a suite, made apart and put together."""

import json
import shutil
from itertools import chain

import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.execution.merge import merge as gather_runs
from experiments.execution.part import Part
from experiments.running.plan import runs_of
from experiments.running.versions import commit_of


@pytest.mark.parametrize("of", [1, 2, 3, 4])
def test_parts_are_the_whole_each_run_once_and_balanced(suite_data, of):
    runs = runs_of(Suite.model_validate(suite_data))
    parts = [Part(number, of).of_runs(runs) for number in range(1, of + 1)]
    assert sorted(run.id for run in chain(*parts)) == sorted(run.id for run in runs)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.mark.parametrize("text", ["0/2", "3/2", "2", "a/b", "1/2/3", "+1/2", "1.0/2", "/"])
def test_a_bad_part_is_refused(text, capsys):
    with pytest.raises(SystemExit) as error:
        main(["run", "a.yaml", "--out", "b", "--part", text])
    assert error.value.code == 2
    assert f"argument --part: found '{text}'; must be K/N" in capsys.readouterr().err


def test_a_part_without_runs_is_refused(suite_data):
    with pytest.raises(ConfigError, match="--part 5/5: nothing to do; the suite has 4 runs"):
        Part(5, 5).of_runs(runs_of(Suite.model_validate(suite_data)))


@pytest.fixture
def parts(finished_once, tmp_path):
    """Two folders that hold two of the four runs each."""
    found = []
    for number in (1, 2):
        part = shutil.copytree(finished_once, tmp_path / f"part{number}")
        for name in ("results.parquet", "report.html", "report.md", "summary.csv"):
            (part / name).unlink()
        about = json.loads((part / "suite.json").read_text())
        mine = {run.id for run in Part(number, 2).of_runs(runs_of(Suite.model_validate(about["suite"])))}
        (part / "suite.json").write_text(json.dumps(about | {"part": f"{number}/2"}))
        for folder in (part / "runs").iterdir():
            if folder.name not in mine:
                shutil.rmtree(folder)
        found.append(part)
    return found


def merge(parts, out):
    return main(["merge", *map(str, parts), "--out", str(out)])


def files(out):
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in [*out.glob("runs/*/*"), out / "results.parquet", out / "summary.csv"]
    }


@pytest.mark.slow
def test_merged_parts_are_the_whole(parts, finished_once, tmp_path, capsys):
    out = tmp_path / "out"
    assert merge(parts, out) == 0
    assert files(out) == files(finished_once)
    assert merge([*parts, out], out) == 0  # again, and with what is the same
    assert files(out) == files(finished_once)
    assert main(["status", str(out)]) == 0
    assert "4 runs: 4 done" in capsys.readouterr().out


def test_the_whole_names_all_commits_that_made_it(parts, tmp_path):
    for part, commit in zip(parts, ("111111111111", "222222222222"), strict=True):
        about = json.loads((part / "suite.json").read_text())
        (part / "suite.json").write_text(json.dumps(about | {"commit": commit}))
        gather_runs([part], tmp_path / "out")
    gather_runs([parts[0]], tmp_path / "out")
    assert commit_of(tmp_path / "out") == "111111111111, 222222222222"


def test_a_part_shows_and_makes_its_own_runs(parts, write_config, suite_data, finished_once, capsys):
    assert main(["status", str(parts[0])]) == 0
    assert "2 runs: 2 done" in capsys.readouterr().out
    command = ["run", str(write_config(suite_data)), "--out", str(parts[1]), "--part", "2/2"]
    shutil.rmtree(next((parts[1] / "runs").iterdir()))
    assert main(command) == 0
    assert "2 runs, 1 of them finished already" in capsys.readouterr().out
    assert {path.name for path in (parts[1] / "runs").iterdir()} == {
        path.name for path in (finished_once / "runs").iterdir()
    } - {path.name for path in (parts[0] / "runs").iterdir()}


def test_what_is_merely_unfinished_is_named_and_left_out(parts, tmp_path, capsys):
    folder = sorted((parts[0] / "runs").iterdir())[0]
    (folder / "DONE.json").unlink()
    assert merge(parts, tmp_path / "out") == 1
    assert f"1 runs FAILED or did not finish: {folder.name}" in capsys.readouterr().err
    assert len(pd.read_parquet(tmp_path / "out" / "results.parquet")["run"].unique()) == 3


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda run: (run / "trials.jsonl").unlink(), "trials.jsonl is missing"),
        (lambda run: (run / "versions.json").unlink(), "versions.json is missing"),
        (lambda run: (run / "DONE.json").write_text('{"pri'), "DONE.json cannot be read"),
        (lambda run: (run / "trials.jsonl").write_text('{"a": 1}\n{"b"'), "trials.jsonl cannot be read"),
        (lambda run: (run / "trials.jsonl").write_text('{"a": 1}'), "trials.jsonl ends within a line"),
        (lambda run: (run / "run.json").write_text("{}"), "run.json cannot be read"),
    ],
)
def test_a_half_written_run_is_refused_by_name(parts, tmp_path, capsys, spoil, said):
    folder = sorted((parts[0] / "runs").iterdir())[0]
    spoil(folder)
    assert merge(parts, tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert f"{folder} is half-written: {said}" in error
    assert not (tmp_path / "out").exists()


def test_different_results_of_one_run_are_refused_by_name(parts, finished_once, tmp_path, capsys):
    folder = sorted((parts[0] / "runs").iterdir())[0]
    trials = folder / "trials.jsonl"
    trials.write_text("".join(trials.read_text().splitlines(keepends=True)[1:]))
    assert merge([*parts, finished_once], tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert str(folder) in error
    assert str(finished_once / "runs" / folder.name) in error
    assert "different results (trials.jsonl)" in error


def test_parts_of_other_suites_or_other_versions_are_refused(parts, tmp_path, capsys):
    about = json.loads((parts[1] / "suite.json").read_text())
    changed = about | {"suite": about["suite"] | {"seed": 5}}
    (parts[1] / "suite.json").write_text(json.dumps(changed))
    assert merge(parts, tmp_path / "out") == 2
    assert (
        f"{parts[1]} is of another configuration than {parts[0]} (seed was 5, is 1)"
        in capsys.readouterr().err
    )
    (parts[1] / "suite.json").write_text(json.dumps(about))
    made_by = sorted((parts[1] / "runs").iterdir())[0] / "versions.json"
    made_by.write_text(json.dumps(json.loads(made_by.read_text()) | {"numpy": "0.9"}))
    assert merge(parts, tmp_path / "out") == 2
    assert "made by other versions (numpy 0.9 there" in capsys.readouterr().err
    assert merge([tmp_path], tmp_path / "out") == 2
    assert "no results here" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
