"""The runner, from a YAML file to the report, with real agents in real processes."""

import argparse
import errno
import json
import os
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.execution.commands import command_of
from experiments.running.results_folder import locked
from experiments.running.versions import REPOSITORY
from tests.experiments.fakes import AIM

UNIQUE_PER_RUN = ["run", "phase", "lifetime_motions", "motions_since_perturbation", "trial"]


def run(config, out):
    return main(["run", str(config), "--out", str(out), "--jobs", "2"])


def test_from_configuration_to_report(finished, capsys):
    config, out = finished
    results = pd.read_parquet(out / "results.parquet")
    assert set(results["agent"]) == {"random", "unified_servo"}
    assert not results.duplicated(UNIQUE_PER_RUN).any()

    held_out = results[results["phase"] == "eval"]
    for _, of_run in held_out.groupby("run"):
        # On schedule at 0, 40, 80; right before and after the perturbation at 50; at the end.
        when = of_run[["lifetime_motions", "motions_since_perturbation"]].fillna(-1).astype(int)
        made = [(0, -1), (40, -1), (50, -1), (50, 0), (80, 30), (90, 40)]
        assert list(when.itertuples(index=False, name=None)) == [each for each in made for _ in range(2)]
    servo = held_out[held_out["agent"] == "unified_servo"]
    assert servo["success"].mean() > held_out[held_out["agent"] == "random"]["success"].mean()

    page = (out / "report.html").read_text()
    assert page.count("<figure>") == 1
    assert all(each in page for each in ("Does &lt;it&gt; run?", "left camera"))
    assert not any(each in page for each in ("<script", "FAILED"))
    assert {path.name for path in (out / "figures").iterdir()} == {"aimed-held-out.png", "aimed-held-out.svg"}

    done = sorted(out.glob("runs/*/DONE.json"))
    before = [path.stat().st_mtime_ns for path in done]
    shutil.rmtree(done[0].parent)
    capsys.readouterr()
    assert run(config, out) == 0
    assert "4 runs, 3 of them finished already" in capsys.readouterr().out
    assert [path.stat().st_mtime_ns for path in done[1:]] == before[1:]
    again = pd.read_parquet(out / "results.parquet")
    pd.testing.assert_frame_equal(results, again)  # the run that was made again is the same


@pytest.mark.parametrize(
    ("before", "lost", "after"),
    [
        ("0123456789ab", 0, "0123456789ab"),
        ("0123456789ab", 1, "later"),
        ("0123456789ab+", 0, "later"),  # its sources, which are the present ones, have been committed since
    ],
)
def test_what_is_finished_keeps_the_commit_that_made_it(finished, monkeypatch, before, lost, after):
    config, out = finished
    about = json.loads((out / "suite.json").read_text())
    (out / "suite.json").write_text(json.dumps(about | {"commit": before}))
    monkeypatch.setattr("experiments.execution.runner.commit", lambda: "later")
    monkeypatch.setattr("experiments.reporting.report.report", lambda source, out: None)
    for folder in list(out.glob("runs/*unified_servo*"))[:lost]:
        shutil.rmtree(folder)
    assert run(config, out) == 0
    assert json.loads((out / "suite.json").read_text())["commit"] == after


def test_results_of_other_code_are_named_and_refused(finished, capsys):
    config, out = finished
    folder = sorted(out.glob("runs/*"))[-1]
    made_by = json.loads((folder / "versions.json").read_text())
    (folder / "versions.json").write_text(json.dumps(made_by | {"code": "older"}))
    for command in (["run", str(config), "--out", str(out)], ["report", str(out)]):
        capsys.readouterr()
        assert main(command) == 2
        said = capsys.readouterr().err
        assert folder.name in said
        assert "code" in said
        assert "another --out" in said
    assert (folder / "DONE.json").exists()


@pytest.mark.slow
def test_results_of_another_configuration_are_named_and_refused(finished, suite_data, write_config, capsys):
    _, out = finished
    changed = write_config(suite_data | {"evaluation": {"every": 60, "trials": 2}})
    capsys.readouterr()
    assert run(changed, out) == 2
    said = capsys.readouterr().err
    assert "holds 4 finished runs that this configuration does not have" in said
    assert "evaluation.every was 40, is 60" in said
    assert run(write_config(suite_data), out) == 0


@pytest.mark.slow
def test_more_worlds_go_on_in_the_same_folder_also_where_it_was_moved(finished, tmp_path, capsys):
    config, out = finished
    out = shutil.move(out, tmp_path / "elsewhere")
    capsys.readouterr()
    assert main(["run", str(config), "--out", str(out), "--set", "worlds=3"]) == 0
    assert "6 runs, 4 of them finished already" in capsys.readouterr().out
    assert main(["report", str(out)]) == 0


AWAY = [{"at": {"motion": 50}, "do": AIM | {"degrees": 180}}]
"""No world can be turned so far."""


@pytest.mark.slow
def test_one_crash_fails_one_run_loudly(suite_data, write_config, tmp_path, capsys):
    aimed = suite_data["scenarios"][0]
    turned = {**aimed, "name": "turned", "perturbations": AWAY}
    suite_data |= {"worlds": 1, "agents": [{"name": "random"}], "scenarios": [aimed, turned]}
    out = tmp_path / "out"
    assert run(write_config(suite_data), out) == 1
    printed = capsys.readouterr()
    assert "FAILED" in printed.out
    assert "the world after" in printed.out
    assert "1 runs FAILED or did not finish" in printed.err
    results = pd.read_parquet(out / "results.parquet")
    assert set(results["scenario"]) == {"aimed"}
    page = (out / "report.html").read_text()
    assert page.index("1 of 2 runs FAILED") < page.index("aimed: held-out trials")
    assert "the world after" in page
    assert main(["report", str(out)]) == 0


def test_curves_are_tensorboard_scalars(finished):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    _, out = finished
    results = pd.read_parquet(out / "results.parquet")
    folder = sorted(out.glob("runs/*unified_servo*"))[0]
    events = EventAccumulator(str(folder)).Reload()

    def shown(name):
        return {event.step: event.value for event in events.Scalars(name)}

    of_run = results[results["run"] == folder.name]
    means = of_run[of_run["phase"] == "eval"].groupby("lifetime_motions")["motions"].mean()
    assert shown("eval/motions") == pytest.approx(means.to_dict())
    own = of_run[of_run["phase"] == "train"].reset_index()
    tens = own.groupby(own.index // 10)
    assert len(tens) > 2
    points = dict(zip(tens["lifetime_motions"].last(), tens["error_px"].mean(), strict=True))
    assert shown("train/error_px") == pytest.approx(points, abs=0.1)  # results have one decimal, rounded up


def test_status_tells_done_failed_interrupted_and_waiting(finished, capsys):
    _, out = finished
    assert main(["status", str(out)]) == 0
    assert "4 runs: 4 done; no runner is at work" in capsys.readouterr().out
    one, two, three, _ = sorted(out.glob("runs/*"))
    for folder in (one, two):
        (folder / "DONE.json").unlink()
    (one / "FAILED.json").write_text(json.dumps({"exit_code": 3, "log_tail": ["boom"]}))
    shutil.rmtree(three)
    assert main(["status", str(out)]) == 1
    found = capsys.readouterr().out
    told = ("exit code 3: boom", "after 90 of 90 motions; begins anew")
    for said in (*told, "1 failed", "1 interrupted", "1 waiting", "1 done"):
        assert said in found
    with locked(out):
        main(["status", str(out)])
    found = capsys.readouterr().out
    assert "1 running" in found
    assert "a runner is at work" in found


def test_two_runners_in_one_folder_are_refused(finished, monkeypatch, capsys):
    config, out = finished
    monkeypatch.setattr("experiments.running.results_folder.PATIENCE", 0.0)
    with locked(out):
        assert main(["run", str(config), "--out", str(out)]) == 2
    assert "another runner is at work here" in capsys.readouterr().err


def test_fail_fast_stops_at_the_first_failure(suite_data, write_config, tmp_path, capsys):
    suite_data["scenarios"][0]["perturbations"] = AWAY
    out = tmp_path / "out"
    command = ["run", str(write_config(suite_data)), "--out", str(out), "--fail-fast"]
    assert main(command) == 1
    assert len(list(out.glob("runs/*/FAILED.json"))) == 1
    assert len(list(out.glob("runs/*"))) == 1
    assert "4 runs FAILED or did not finish" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "film", "benchmark", "report"])
def test_where_nothing_can_be_written_nothing_is_begun(command, finished, capsys, monkeypatch):
    """/proc takes no folder of anybody, however mighty."""
    config, done = finished
    for begins in ("execution.pending.write_pending", "film.command.Screen", "studies.measure"):
        monkeypatch.setattr(f"experiments.{begins}", None)
    what = {"run": config, "film": REPOSITORY / "configs/film.yaml", "benchmark": "speed"}.get(command, done)
    out = "/proc/xx/speed.json" if command == "benchmark" else "/proc/xx"
    assert main([command, str(what), "--out", out]) == 2
    said = "this folder cannot be made or written into (No such file or directory); nothing was run; allowed:"
    assert capsys.readouterr().err == f"error: /proc/xx: {said} a folder that can\n"


@pytest.mark.parametrize("command", ["run", "tune", "film", "report"])
def test_a_file_in_place_of_a_folder_is_told_first(command, tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("")
    assert main([command, "nowhere", "--out", str(file)]) == 2
    said = f"error: --out: {file} is a file; allowed: a folder, which need not be there yet\n"
    assert capsys.readouterr().err == said


@pytest.mark.slow
def test_a_full_disk_loses_nothing(suite_data, write_config, tmp_path, capsys, monkeypatch):
    config, out = write_config(suite_data), tmp_path / "out"
    real = os.fsync
    left = iter([None] * 13)  # the suite, four pending runs, and two workers

    def full(descriptor):
        if next(left, "full") == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    assert main(["run", str(config), "--out", str(out)]) == 2
    assert "No space left on device; what has finished is kept" in capsys.readouterr().err
    done = len(list(out.glob("runs/*/DONE.json")))
    assert done >= 1
    monkeypatch.setattr(os, "fsync", real)
    assert run(config, out) == 0
    assert f"4 runs, {done} of them finished already" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('{"suite": {"name": "a", "runs": 3}, "command": "c"}', r"earlier form \(question: Field required\)"),
        ('{"command": "c"}', r"earlier form \(suite: Field required\)"),
        ("[]", r"earlier form \(found list; allowed: a mapping\)"),
        ('{"suite"', r"earlier form \(Expecting"),
    ],
)
def test_a_folder_of_earlier_code_is_one_message(tmp_path, capsys, text, what):
    (tmp_path / "suite.json").write_text(text)
    for command in ("status", "report"):
        assert main([command, str(tmp_path)]) == 2
        said = capsys.readouterr().err
        assert re.search(what, said)
        assert f"{tmp_path / 'suite.json'} is damaged, or of an earlier form" in said
        assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("config", "named"),
    [
        (REPOSITORY / "configs" / "paper.yaml", "configs/paper.yaml"),
        (Path("/somewhere/else/mine.yaml"), "mine.yaml"),
    ],
)
def test_the_command_names_no_folder_of_this_machine(config, named):
    options = argparse.Namespace(config=config, set=["worlds=2"], modules=["lab"])
    made_by = f"python -m experiments run {named} --out DIR --set worlds=2 --import lab"
    assert command_of(options) == made_by


def test_user_errors_are_one_message(capsys, tmp_path):
    assert main(["validate", str(tmp_path / "no.yaml")]) == 2
    assert "no.yaml" in capsys.readouterr().err
    assert main(["report", str(tmp_path)]) == 2
    assert "no results here" in capsys.readouterr().err


def test_runs_made_in_several_folders_are_one_suite_where_they_are_copied_together(
    finished, write_config, suite_data, capsys
):
    config, part = finished
    whole = part.with_name("whole")
    for folder in sorted(part.glob("runs/*"))[:3]:
        shutil.copytree(folder, whole / "runs" / folder.name)
    assert run(config, whole) == 0
    assert "4 runs, 3 of them finished already" in capsys.readouterr().out
    assert (whole / "summary.csv").read_bytes() == (part / "summary.csv").read_bytes()


RUN = ["run", "a.yaml", "--out", "b"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([*RUN, "--jobs", "0"], "argument --jobs: found '0'; must be a whole number, 1 or more"),
        (["merge", "a", "b", "--out", "c"], "merge is no command any more: copy all folders of PART/runs"),
        ([*RUN, "--part", "1/2"], "--part is no option any more: --cluster shares"),
        ([*RUN, "--slurm"], "--slurm is no option any more: let Slurm start Dask's"),
        ([*RUN, "--slurm-option", "qos=low"], "--slurm-option is no option any more"),
    ],
)
def test_what_is_wrong_or_gone_in_a_command_is_said(arguments, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert said in capsys.readouterr().err
