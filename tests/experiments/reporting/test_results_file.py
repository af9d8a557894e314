"""results.parquet holds all that a report is made of."""

import json
import shutil

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from experiments.__main__ import main
from experiments.config.environment import EnvironmentConfig
from experiments.config.suite import FIRST_OWN_TRIALS, ScenarioConfig
from experiments.errors import ConfigError
from experiments.reporting.report import computing_section
from experiments.reporting.results_file import MOST_OWN_TRIALS, _in_words, gather, read_finished
from experiments.running.results_folder import read_suite
from experiments.running.run import runs_of


@pytest.fixture
def parquet(finished_once, tmp_path):
    """A copy that a test may change, with nothing beside it."""
    return shutil.copy(finished_once / "results.parquet", tmp_path / "results.parquet")


def files(folder):
    figures = [f"figures/{path.name}" for path in folder.glob("figures/*")]
    names = ["report.html", "report.md", "summary.csv", "tables.json", *figures]
    return {name: (folder / name).read_bytes() for name in names}


def test_the_report_is_made_from_the_file_alone(finished_once, parquet, tmp_path):
    """Byte for byte, where the file of times is beside it."""
    shutil.copy(finished_once / "timings.csv", tmp_path)
    assert main(["report", str(parquet), "--out", str(tmp_path / "again")]) == 0
    assert files(tmp_path / "again") == files(finished_once)


def test_times_stand_in_a_file_of_their_own(finished_once, parquet, tmp_path):
    (timeless,) = computing_section(read_finished(parquet, tmp_path)).tables
    assert [row[1:] for row in timeless.rows] == [["–", "–", "–"]] * 2
    shutil.copy(finished_once / "timings.csv", tmp_path)
    (table,) = computing_section(read_finished(parquet, tmp_path)).tables
    timed = table.rows
    times = pd.read_csv(tmp_path / "timings.csv")
    of_servo = times[times["run"].str.contains("unified_servo")]
    assert timed[1][-3] == f"{of_servo['wall_seconds'].sum():,.0f}"
    assert timed[1][-2] == f"{1000 * of_servo['decision'].median():.2g}"


def test_a_number_of_the_summary_is_that_of_the_rows(parquet, finished_once):
    rows, summary = (
        pd.read_parquet(parquet),
        pd.read_csv(finished_once / "summary.csv", dtype={"commit": str}),
    )
    held_out = rows[(rows["agent"] == "unified_servo") & (rows["phase"] == "eval")]
    before = held_out[held_out["motions_since_perturbation"].isna() & (held_out["lifetime_motions"] == 50)]
    cost = before["motions"].where(before["rendezvous"], 20)
    shown = summary.set_index(["table", "agent", "moment", "measure"])["value"]
    found = shown.loc["held_out", "unified_servo", "before", "motions_per_reach"]
    assert found == pytest.approx(cost.groupby(before["world"]).mean().mean())


def test_rows_are_those_of_the_logs(finished_once):
    rows = pd.read_parquet(finished_once / "results.parquet").set_index("run")
    for log in finished_once.glob("runs/*/trials.jsonl"):
        logged = pd.DataFrame(map(json.loads, log.read_text().splitlines()))
        mine = rows.loc[log.parent.name]
        for exact in ("trial", "motions", "lifetime_motions", "success", "rendezvous", "phase"):
            assert list(mine[exact]) == list(logged[exact])
        assert np.abs(mine["robot_seconds"].to_numpy() - logged["robot_seconds"]).max() <= 0.051
        up = mine["error_px"].to_numpy() - logged["error_px"]
        assert up.min() > -1e-9
        assert up.max() < 0.1
        for px in (2, 4, 8, 16):
            assert list(mine["error_px"] <= px) == list(logged["error_px"] <= px)


def test_an_error_of_the_tolerance_stays_within_it_and_a_larger_one_outside(finished):
    _, out = finished
    (log, *_) = sorted(out.glob("runs/*/trials.jsonl"))
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    exact = [4.0, np.nextafter(4.0, 5), np.nextafter(4.0, 3), 2.0, np.nextafter(16.0, 17)]
    for row, error in zip(rows, exact, strict=False):
        row["error_px"] = error
    log.write_text("\n".join(map(json.dumps, rows)))
    found = pd.read_parquet(gather(out))
    kept = found.loc[found["run"] == log.parent.name, "error_px"].iloc[: len(exact)]
    assert [each <= 4 for each in kept] == [True, False, True, True, False]
    assert list(kept) == [4.0, 4.1, 4.0, 2.0, 16.1]


def test_of_very_many_own_trials_some_are_kept_and_all_held_out_ones(finished):
    _, out = finished
    (log, *_) = sorted(out.glob("runs/*/trials.jsonl"))
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    own = next(row for row in rows if row["phase"] == "train")
    many = 2 * MOST_OWN_TRIALS + 1
    held_out = [row for row in rows if row["phase"] == "eval"]
    lines = [json.dumps(own | {"trial": trial}) for trial in range(many)] + list(map(json.dumps, held_out))
    log.write_text("\n".join(lines))
    found = pd.read_parquet(gather(out))
    mine = found[found["run"] == log.parent.name]
    kept = [*range(FIRST_OWN_TRIALS), *range(FIRST_OWN_TRIALS + 2, many, 3)]
    assert list(mine.loc[mine["phase"] == "train", "trial"]) == kept
    assert (mine["phase"] == "eval").sum() == len(held_out)


def test_what_a_run_says_and_why_one_failed_is_in_the_file(finished):
    _, out = finished
    done, *_ = sorted(out.glob("runs/*/DONE.json"))
    done.unlink()
    (done.parent / "FAILED.json").write_text(json.dumps({"exit_code": 1, "log_tail": ["Oh <no>"]}))
    found = read_finished(gather(out), out)
    (suite, command) = read_suite(out)
    assert (found.suite, found.command) == (suite, command)
    assert found.failures == {done.parent.name: ["Oh <no>"]}
    assert found.outcomes.keys() == {run.id for run in runs_of(suite)} - {done.parent.name}
    for outcome in found.outcomes.values():
        ((motions, _, what),) = outcome["perturbations"]
        assert (motions, what) == (50, "camera_aim (camera left, degrees 20)")
    assert len(found.timings) == 3
    main(["report", str(out)])
    page = (out / "report.html").read_text()
    assert page.index("1 of 4 runs FAILED") < page.index("aimed: held-out trials")
    assert "Oh &lt;no&gt;" in page


def with_metadata(parquet, metadata):
    table = pq.read_table(parquet)
    pq.write_table(table.replace_schema_metadata(metadata), parquet)


def test_files_that_are_no_results_are_refused(parquet, tmp_path, capsys):
    with pytest.raises(ConfigError, match=r"gone.parquet: there is no such file"):
        read_finished(tmp_path / "gone.parquet", tmp_path)
    (tmp_path / "cut.parquet").write_bytes(parquet.read_bytes()[:3000])
    assert main(["report", str(tmp_path / "cut.parquet"), "--out", str(tmp_path)]) == 2
    assert "cut.parquet is damaged, or no Parquet file" in capsys.readouterr().err
    with_metadata(parquet, {})
    with pytest.raises(ConfigError, match="says nothing of a suite: it was made by other code"):
        read_finished(parquet, tmp_path)
    with_metadata(parquet, {"calfree": "nonsense"})
    with pytest.raises(ConfigError, match="is damaged"):
        read_finished(parquet, tmp_path)


def test_a_file_without_a_column_is_refused(parquet, tmp_path):
    table = pq.read_table(parquet)
    pq.write_table(table.drop_columns(["error_px"]), parquet)
    with pytest.raises(ConfigError, match="lacks the columns error_px: it was made by other code"):
        read_finished(parquet, tmp_path)


@pytest.mark.parametrize(
    "text", ["", "run,wall_seconds,decision\na,1,2\n", "run,wall_seconds,decision,learning\na,1,2,soon\n"]
)
def test_damaged_times_are_refused(parquet, tmp_path, text):
    (tmp_path / "timings.csv").write_text(text)
    with pytest.raises(ConfigError, match=r"timings\.csv is damaged .* delete it, or make it anew"):
        read_finished(parquet, tmp_path)


def test_a_run_whose_log_is_damaged_is_named(finished, capsys):
    _, out = finished
    (log, *_) = sorted(out.glob("runs/*/trials.jsonl"))
    log.write_text(log.read_text()[:-30])
    assert main(["report", str(out)]) == 2
    assert f"{log} is damaged" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["{", "[]", '"a"'])
@pytest.mark.parametrize("name", ["DONE.json", "versions.json", "timings.json", "trials.jsonl"])
def test_whatever_is_damaged_in_a_run_is_named(finished, capsys, name, text):
    _, out = finished
    (damaged, *_) = sorted(out.glob(f"runs/*/{name}"))
    damaged.write_text(text)
    assert main(["report", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{damaged} is damaged" in line
    assert f"delete {damaged.parent}, and run" in line


def test_a_perturbation_is_called_by_the_entry_that_says_most_of_those_that_were_due():
    scenario = ScenarioConfig(
        name="changed",
        env=EnvironmentConfig(id="CalFree/Reach-v0", world="wild"),
        motions=1000,
        perturbations=(
            {"drift": {"per": "motion"}, "do": {"type": "joint_zero"}},
            {"at": {"trial": 5}, "do": {"type": "joint_zero", "joint": "J2", "degrees": 10}},
            {"at": {"motion": 100}, "do": {"type": "camera_replace"}},
            {"at": {"every": {"motion": 200}}, "do": {"type": "camera_replace", "camera": "left"}},
        ),
    )

    def words(motions, trials, **drawn):
        return _in_words(drawn, scenario, {"motion": motions, "trial": trials})

    assert words(1, 0, type="joint_zero", joint="J2", degrees=0.02) == "drift: joint_zero"
    assert words(40, 5, type="joint_zero", joint="J2", degrees=10) == "joint_zero (joint J2, degrees 10)"
    assert words(100, 9, type="camera_replace", camera="left", seed=3) == "camera_replace"
    assert words(200, 12, type="camera_replace", camera="left", seed=4) == "camera_replace (camera left)"
