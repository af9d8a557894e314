"""The runner, from a YAML file to the report, with real agents in real processes."""

import json
import shutil

import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.loading import load
from experiments.plan import runs_of

UNIQUE_PER_RUN = ["run", "phase", "lifetime_motions", "trial"]


def run(config, out):
    return main(["run", str(config), "--out", str(out), "--jobs", "2"])


@pytest.fixture
def finished(suite_data, write_config, tmp_path):
    config, out = write_config(suite_data), tmp_path / "out"
    assert run(config, out) == 0
    return config, out


def test_from_configuration_to_report(finished, capsys):
    config, out = finished
    results = pd.read_parquet(out / "results.parquet")
    assert set(results["agent"]) == {"random", "unified_servo"}
    assert not results.duplicated(UNIQUE_PER_RUN).any()

    held_out = results[results["phase"] == "eval"]
    for _, of_run in held_out.groupby("run"):
        # On schedule at 0, 40, 80; right after the perturbation at 50; at the end.
        assert list(of_run["lifetime_motions"].unique()) == [0, 40, 51, 80, 90]
        assert (of_run.groupby("lifetime_motions").size() == 2).all()
        since = of_run.groupby("lifetime_motions")["motions_since_perturbation"].first()
        assert since.loc[[0, 40]].isna().all()
        assert list(since.loc[[51, 80, 90]]) == [1, 30, 40]
    servo = held_out[held_out["agent"] == "unified_servo"]
    assert servo["success"].mean() > held_out[held_out["agent"] == "random"]["success"].mean()

    page = (out / "report.html").read_text()
    assert "<script" not in page
    assert page.count("<svg") == 2
    assert "Does &lt;it&gt; run?" in page
    assert "camera_aim (camera left, degrees 20)" in page
    assert "FAILED" not in page
    for name in ("aimed-held-out", "aimed-training"):
        assert (out / "figures" / f"{name}.png").exists()
        assert (out / "figures" / f"{name}.svg").exists()

    done = sorted(out.glob("runs/*/DONE.json"))
    before = [path.stat().st_mtime_ns for path in done]
    shutil.rmtree(done[0].parent)
    capsys.readouterr()
    assert run(config, out) == 0
    assert "4 runs, 3 of them finished already" in capsys.readouterr().out
    assert [path.stat().st_mtime_ns for path in done[1:]] == before[1:]
    again = pd.read_parquet(out / "results.parquet")
    pd.testing.assert_frame_equal(results, again)  # the run that was made again is the same


def test_results_of_other_code_are_set_aside(finished, capsys):
    config, out = finished
    folder = next(out.glob("runs/*"))
    made_by = json.loads((folder / "versions.json").read_text())
    (folder / "versions.json").write_text(json.dumps(made_by | {"code": "older"}))
    capsys.readouterr()
    assert run(config, out) == 0
    assert f"{folder.name}: finished with other versions of code" in capsys.readouterr().out
    assert (out / "stale" / f"{folder.name}-older" / "DONE.json").exists()
    assert (folder / "DONE.json").exists()


def test_one_crash_fails_one_run_loudly(suite_data, write_config, tmp_path, capsys):
    aimed = suite_data["scenarios"][0]
    away = {"type": "camera_aim", "camera": "left", "degrees": 180}
    turned = {**aimed, "name": "turned", "perturbations": [{"at": {"motion": 50}, "do": away}]}
    suite_data |= {"worlds": 1, "agents": [{"name": "random"}], "scenarios": [aimed, turned]}
    out = tmp_path / "out"
    assert run(write_config(suite_data), out) == 1
    printed = capsys.readouterr()
    assert "FAILED" in printed.out
    assert "the world after" in printed.out
    assert "1 runs FAILED" in printed.err
    results = pd.read_parquet(out / "results.parquet")
    assert set(results["scenario"]) == {"aimed"}
    page = (out / "report.html").read_text()
    assert page.index("1 of 2 runs FAILED") < page.index("Scenario aimed")
    assert "the world after" in page
    assert "<td>random</td><td>no run finished</td><td>0 of 1</td>" in page
    assert main(["report", str(out)]) == 0


def test_a_report_is_of_the_last_suites_finished_runs_alone(finished, suite_data, write_config):
    _, out = finished
    config = write_config(suite_data | {"evaluation": {"every": 60, "trials": 2}})
    assert run(config, out) == 0
    newest = {spec.id for spec in runs_of(load(config))}
    done = sorted(path for path in out.glob("runs/*/DONE.json") if path.parent.name in newest)
    done[0].unlink()  # as an interrupt would have left it
    assert main(["report", str(out)]) == 0
    results = pd.read_parquet(out / "results.parquet")
    assert set(results["run"]) == newest - {done[0].parent.name}
    page = (out / "report.html").read_text()
    assert "1 of 4 runs FAILED or did not finish" in page
    assert f"{done[0].parent.name}  " in page
    assert "(never finished)" in page


def test_user_errors_are_one_message(capsys, tmp_path):
    assert main(["validate", str(tmp_path / "no.yaml")]) == 2
    assert "no.yaml" in capsys.readouterr().err
    assert main(["report", str(tmp_path)]) == 2
    assert "no results here" in capsys.readouterr().err
    with pytest.raises(SystemExit) as error:
        main(["run", "a.yaml", "--out", "b", "--jobs", "0"])
    assert error.value.code == 2
    assert "argument --jobs: found '0'; must be a whole number, 1 or more" in capsys.readouterr().err


def test_validate_counts_the_work(suite_data, write_config, capsys):
    assert main(["validate", str(write_config(suite_data))]) == 0
    assert "2 agents × 1 scenarios × 2 worlds = 4 runs, 360 motions" in capsys.readouterr().out
