"""results.parquet holds all that a report is made of."""

import itertools
import json
import shutil

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from experiments.__main__ import main
from experiments.config.claims import Requirement, TrialsOf
from experiments.config.suite import FIRST_OWN_TRIALS
from experiments.errors import ConfigError
from experiments.reporting import results_file
from experiments.reporting.report import computing_section, films_in
from experiments.reporting.results_file import (
    METADATA,
    MOST_OWN_TRIALS,
    gather,
    packed,
    read_about,
    read_finished,
)
from experiments.running.results_folder import read_suite
from experiments.running.run import runs_of


@pytest.fixture
def a_log(finished):
    """The log of a run of results that a test may change, with its rows."""
    (log, *_) = sorted(finished[1].glob("runs/*/trials.jsonl"))
    return log, [json.loads(line) for line in log.read_text().splitlines()]


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


@pytest.mark.parametrize("asked", [False, True])
def test_first_motions_of_own_trials_are_kept_where_a_criterion_asks(finished, monkeypatch, asked):
    suite, command = read_suite(finished[1])
    of = TrialsOf(agent=suite.agents[0].label, scenario=suite.scenarios[0].name, trials=(1, 2))
    required = (Requirement(measure="first_motion", of=of, at_least=0.5),) * asked
    told = suite.model_copy(update={"required": required})
    monkeypatch.setattr(results_file, "read_suite", lambda _: (told, command))
    own = pd.read_parquet(gather(finished[1])).query("phase == 'train'")
    assert own["motions_to_16"].notna().any() == asked


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


def test_a_summary_has_every_number_of_the_report_which_is_that_of_the_rows(finished_once):
    rows = pd.read_parquet(finished_once / "results.parquet")
    summary = pd.read_csv(finished_once / "summary.csv", dtype={"commit": str})
    assert set(summary["table"]) == {"held_out", "checkpoints", "profile", "threshold", "comparison"}
    assert summary[["config", "commit", "code", "mujoco"]].notna().all(axis=None)
    shown = summary[summary["table"] == "held_out"]
    motions = {f"motions_per_reach{of}" for of in ("", "_among_reached")}
    distances = {"distance_mm", "distance_mm_95", "far"}
    assert set(shown["measure"]) == {"success", "rendezvous", *motions, *distances}
    assert len(shown) == 2 * 3 * 7
    held_out = rows[(rows["agent"] == "unified_servo") & (rows["phase"] == "eval")]
    end = held_out[held_out["lifetime_motions"] == 90]
    before = held_out[held_out["motions_since_perturbation"].isna() & (held_out["lifetime_motions"] == 50)]
    cost = before["motions"].where(before["rendezvous"], 20)
    found = shown[shown["agent"] == "unified_servo"].set_index(["moment", "measure"])
    expected = cost.groupby(before["world"]).mean().mean()
    assert found.loc[("before", "motions_per_reach"), "value"] == pytest.approx(expected)
    assert found.loc[("at the end", "success"), "value"] == end["success"].mean()
    assert found.loc[("at the end", "success"), "n"] == end["world"].nunique() == 2
    assert found.loc[("at the end", "distance_mm"), "value"] == end["distance_mm"].median()


def test_rows_are_those_of_the_logs(finished_once):
    rows = pd.read_parquet(finished_once / "results.parquet").set_index("run")
    for log in finished_once.glob("runs/*/trials.jsonl"):
        logged = pd.DataFrame(map(json.loads, log.read_text().splitlines()))
        mine = rows.loc[log.parent.name]
        for exact in ("trial", "motions", "lifetime_motions", "success", "rendezvous", "phase"):
            assert list(mine[exact]) == list(logged[exact])
        assert np.abs(mine["robot_seconds"].to_numpy() - logged["robot_seconds"]).max() <= 0.051
        for rounded in ("error_px", "distance_mm"):
            up = mine[rounded].to_numpy() - logged[rounded]
            assert up.min() > -1e-9
            assert up.max() < 0.1
        for px in (2, 4, 8, 16):
            assert list(mine["error_px"] <= px) == list(logged["error_px"] <= px)


def test_an_error_of_the_tolerance_stays_within_it_and_a_larger_one_outside(finished, a_log):
    (_, out), (log, rows) = finished, a_log
    exact = [4.0, np.nextafter(4.0, 5), np.nextafter(4.0, 3), 2.0, np.nextafter(16.0, 17)]
    for row, error in zip(rows, exact, strict=False):
        row["error_px"] = error
    log.write_text("\n".join(map(json.dumps, rows)))
    found = pd.read_parquet(gather(out))
    kept = found.loc[found["run"] == log.parent.name, "error_px"].iloc[: len(exact)]
    assert [each <= 4 for each in kept] == [True, False, True, True, False]
    assert list(kept) == [4.0, 4.1, 4.0, 2.0, 16.1]


def test_of_very_many_own_trials_some_are_kept_and_all_held_out_ones(finished, a_log):
    (_, out), (log, rows) = finished, a_log
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


def test_a_report_is_of_the_finished_runs_alone_and_the_file_says_why_others_are_not(finished):
    _, out = finished
    failed, *done, stopped = (path.parent for path in sorted(out.glob("runs/*/DONE.json")))
    for each in (failed, stopped):
        (each / "DONE.json").unlink()  # as an interrupt would have left it
    (out / "results.parquet").unlink()
    (failed / "FAILED.json").write_text(json.dumps({"exit_code": 1, "log_tail": ["Oh <no>"]}))
    found = read_finished(gather(out), out)
    (suite, command) = read_suite(out)
    assert (found.suite, found.command) == (suite, command)
    assert found.failures == {failed.name: ["Oh <no>"]}
    assert found.outcomes.keys() == {run.id for run in runs_of(suite)} - {failed.name, stopped.name}
    for outcome in found.outcomes.values():
        assert outcome.keys() >= {"privileged", "prior_knowledge"}
    assert len(found.timings) == 2
    assert main(["report", str(out)]) == 0
    assert set(pd.read_parquet(out / "results.parquet")["run"]) == {each.name for each in done}
    page = (out / "report.html").read_text()
    assert page.index("2 of 4 runs FAILED or did not finish") < page.index("aimed: held-out trials")
    assert "Oh &lt;no&gt;" in page
    assert f"{stopped.name}  " in page
    assert "(never finished)" in page


@pytest.mark.parametrize(
    ("spoiled", "said"),
    [
        (lambda table: table.replace_schema_metadata({}), "says nothing of a suite: it was made by other"),
        (lambda table: table.replace_schema_metadata({"calfree": "nonsense"}), "is damaged"),
        (lambda table: table.drop_columns(["error_px"]), "lacks the columns error_px: it was made by other"),
    ],
)
def test_files_of_other_code_are_refused(parquet, tmp_path, spoiled, said):
    pq.write_table(spoiled(pq.read_table(parquet)), parquet)
    with pytest.raises(ConfigError, match=said):
        read_finished(parquet, tmp_path)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ([1], "says list of its suite"),
        ({"outcomes": 5}, "outcomes: Input should be a valid dictionary"),
        ({"outcomes": {"run": {}}}, "outcomes.run.privileged: Field required"),
        ({"failures": {"run": 5}}, "failures.run: Input should be a valid list"),
        ({"versions": {"commit": "=HYPERLINK(1)"}}, "versions.commit: String should match"),
        ({"arm": {"model": "<mujoco/>", "gripper": "tip"}}, "holds the model of an arm; allowed"),
    ],
)
def test_what_a_stranger_says_of_a_suite_is_no_model_and_no_formula(parquet, tmp_path, told, said):
    about = read_about(parquet).model_dump()
    if isinstance(told, dict) and "arm" in told:
        about["suite"]["scenarios"][0]["env"] |= told
    else:
        about = told if isinstance(told, list) else about | told
    pq.write_table(pq.read_table(parquet).replace_schema_metadata({METADATA: packed(about)}), parquet)
    with pytest.raises(ConfigError, match=said):
        read_finished(parquet, tmp_path)


@pytest.mark.parametrize("folder", ["figures", "runs", "runs/.attempts"])
def test_a_folder_that_leads_elsewhere_is_not_written_into(finished, tmp_path, capsys, folder):
    config, out = finished
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("mine")
    shutil.rmtree(out / folder, ignore_errors=True)
    (out / folder).parent.mkdir(exist_ok=True)
    (out / folder).symlink_to(tmp_path / "mine")
    assert main(["run", str(config), "--out", str(out)]) == 2
    assert f"{out / folder} is a link to something else" in capsys.readouterr().err
    assert (tmp_path / "mine/thesis.txt").read_text() == "mine"


def test_a_lock_that_leads_elsewhere_is_not_opened(finished, tmp_path, capsys):
    config, out = finished
    (tmp_path / "thesis.txt").write_text("mine")
    (out / ".lock").unlink(missing_ok=True)
    (out / ".lock").symlink_to(tmp_path / "thesis.txt")
    for command in (["run", str(config), "--out", str(out)], ["status", str(out)]):
        assert main(command) == 2
        assert f"{out / '.lock'} is a link to something else" in capsys.readouterr().err
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_no_film_leads_elsewhere_or_is_no_picture(tmp_path):
    (tmp_path / "secret").write_text("key")
    (tmp_path / "film.gif").symlink_to(tmp_path / "secret")
    (tmp_path / "film.png").write_text("key")
    assert films_in(tmp_path) == []
    (tmp_path / "film.png").write_bytes(b"\x89PNG\r\n")
    assert films_in(tmp_path) == [tmp_path / "film.png"]


def test_files_that_are_no_results_are_refused(parquet, tmp_path, capsys):
    with pytest.raises(ConfigError, match=r"gone.parquet: there is no such file"):
        read_finished(tmp_path / "gone.parquet", tmp_path)
    (tmp_path / "cut.parquet").write_bytes(parquet.read_bytes()[:3000])
    assert main(["report", str(tmp_path / "cut.parquet"), "--out", str(tmp_path)]) == 2
    assert "cut.parquet is damaged, or no Parquet file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text", ["", "run,wall_seconds,decision\na,1,2\n", "run,wall_seconds,decision,learning\na,1,2,soon\n"]
)
def test_damaged_times_are_refused(parquet, tmp_path, text):
    (tmp_path / "timings.csv").write_text(text)
    with pytest.raises(ConfigError, match=r"timings\.csv is damaged .* delete it, or make it anew"):
        read_finished(parquet, tmp_path)


def test_runs_that_only_the_file_holds_are_not_lost(finished, capsys):
    _, out = finished
    before = (out / "results.parquet").read_bytes()
    shutil.rmtree(next(out.glob("runs/*/")))
    assert main(["report", str(out)]) == 2
    assert "holds 1 finished run that runs lacks" in capsys.readouterr().err
    assert (out / "results.parquet").read_bytes() == before


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *itertools.product(["DONE.json", "versions.json", "timings.json", "trials.jsonl"], ["{", "[]", "5"]),
        ("DONE.json", "{}"),
        ("timings.json", '{"wall_seconds": "x", "cpu_seconds_a_motion": {}}'),
        ("trials.jsonl", "[" * 100_000),
        ("trials.jsonl", '{"motions": 1000000000000}'),
        ("trials.jsonl", '{"success": "yes"}'),
    ],
)
def test_whatever_is_damaged_in_a_run_is_named(finished, capsys, name, text):
    _, out = finished
    (damaged, *_) = sorted(out.glob(f"runs/*/{name}"))
    damaged.write_text(text)
    assert main(["report", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{damaged} is damaged" in line
    assert f"delete {damaged.parent}, and run" in line
