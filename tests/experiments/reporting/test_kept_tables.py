"""Tables of README.md and docs/ are made from kept results, and are what they are made to be."""

import json
import re
import shutil

import pandas as pd
import pytest

import agents
from experiments.__main__ import main
from experiments.errors import ConfigError
from experiments.reporting import kept_tables
from experiments.reporting.figures import in_words
from experiments.reporting.kept_tables import outdated, pages, tables_named
from experiments.reporting.tables import Table, must_know

FRAME = pd.DataFrame({"agent": ["memory"], "success": [0.9876]})


@pytest.fixture
def kept(tmp_path, finished_once):
    """Results of a suite and of a benchmark, kept as the lead engineer keeps them."""
    folder = tmp_path / "results"
    for name in ("quick", "controllers", "only_a_report"):
        (folder / name).mkdir(parents=True)
    shutil.copy(finished_once / "tables.json", folder / "quick")
    tables = [Table(name, name.title(), FRAME, {"success": ".1%"}).to_dict() for name in ("first", "later")]
    document = {"commit": "abc", "versions": {}, "tables": tables}
    (folder / "controllers" / "two_cores.json").write_text(json.dumps(document))
    (folder / "only_a_report" / "report.md").write_text("# old\n")
    return folder


@pytest.mark.slow
def test_the_pages_are_what_kept_results_make_them():
    changed = outdated(pages(), tables_named)
    assert not changed, f"run make results-tables: {[path.name for path in changed]}"


def test_every_agent_says_what_it_must_know():
    rows = [line.strip("| ").split(" | ") for line in tables_named("agents").splitlines()[2:]]
    known = {re.match(r"\[`(\w+)`\]", agent)[1]: must for agent, _, must in rows}
    assert tuple(known) == agents.names()
    assert known["random"] == must_know((), ()) == "nothing"
    assert known["oracle"] == "`object_registers`"
    assert known["joint_space_servo"] == "`joint_angles`, image scale, noise, word limit"


def test_budgets_are_the_times_of_runs_on_two_cores(kept):
    times = "run,wall_seconds,decision,learning\na,200,,\nb,160.0,1e-3,\n"
    (kept / "quick" / "timings.csv").write_text(times)
    (row,) = tables_named("budgets", kept).splitlines()[2:]
    assert row.startswith("| 1 | `quick` | 3 | A camera is knocked")
    for suite, minutes in (("paper", 100), ("arms", 60), ("rivals", 47)):
        (kept / suite).mkdir()
        seconds = minutes * 60 * kept_tables.CORES
        (kept / suite / "timings.csv").write_text(f"run,wall_seconds,decision,learning\na,{seconds},,\n")
    groups = [row.split("|")[1:4] for row in tables_named("budgets", kept).splitlines()[2:]]
    found = [(int(group), suite.strip(" `"), int(minutes)) for group, suite, minutes in groups]
    assert found == [(1, "paper", 100), (1, "quick", 3), (1, "rivals", 47), (2, "arms", 60)]


def test_a_suite_is_one_table_a_scenario(kept, finished_once):
    lines = tables_named("quick/aimed", kept).splitlines()
    head, _, servo = lines[0], lines[1], lines[3]
    assert head == (
        "| agent | what it must know | motions per reach before → right after the knock | "
        "trials that reach right after | motions until 95 % of trials reach → again after it |"
    )
    assert servo.startswith(f"| {in_words('unified_servo', 'unified_servo')} | image size, noise |")
    commit = json.loads((kept / "quick" / "tables.json").read_text())["commit"]
    assert lines[-1] == f"*Made from `experiments/results/quick`, code of commit {commit}.*"
    assert tables_named("quick", kept) == tables_named("quick/aimed", kept)


def test_every_table_of_its_report_has_a_name(kept, finished_once):
    report = (finished_once / "report.md").read_text()
    for name in ("moments", "intervals", "checkpoints", "threshold", "profile", "comparison"):
        table = tables_named(f"quick/aimed-{name}", kept).split("\n\n")
        assert [part for part in table if part.startswith("|")]
        assert all(part in report for part in table if part.startswith("|"))


def test_a_benchmark_is_its_tables_or_one_of_them(kept):
    text = tables_named("controllers", kept)
    assert text.index("**First**") < text.index("**Later**")
    one = tables_named("controllers/later", kept)
    assert one.splitlines()[2] == "| memory | 98.8 % |"
    assert "**" not in one
    assert one.endswith("code of commit abc.*")
    narrow = tables_named("controllers/later: success", kept)
    assert narrow.splitlines()[:3] == ["| success |", "| --- |", "| 98.8 % |"]
    assert "memory" not in tables_named("controllers/later without memory", kept)


def test_what_is_not_kept_is_answered_by_what_is(kept):
    for name, said in {
        "quik": r"'quik' \(did you mean quick\?\); allowed: agents, budgets, controllers, quick",
        "only_a_report": "allowed: agents, budgets, controllers, quick",
        "controllers/later: sucess": r"no column 'sucess' .*success\?\); allowed: agent, success",
        "controllers/later without memry": r"no row 'memry' \(did you mean memory\?\)",
        "controllers/latr": r"no table 'latr' \(did you mean later\?\); allowed: first, later",
    }.items():
        with pytest.raises(ConfigError, match=said):
            tables_named(name, kept)
    (kept / "quick" / "tables.json").write_text('{"a": 1}')
    (kept / "controllers" / "two_cores.json").write_text("{")
    for name in ("quick", "controllers"):
        with pytest.raises(ConfigError, match=f"{name}.*is damaged or no kept result"):
            tables_named(name, kept)


def test_results_tables_fills_pages_and_checks_them(kept, tmp_path, monkeypatch, capsys):
    page = tmp_path / "README.md"
    page.write_text("Before.\n\n<!-- table: controllers/first -->\nold\n<!-- end of table -->\n\nAfter.\n")
    monkeypatch.setattr(kept_tables, "pages", lambda: [page])
    monkeypatch.setattr(kept_tables.tables_named, "__defaults__", (kept,))
    assert main(["results-tables", "--check"]) == 1
    assert "README.md: differs" in capsys.readouterr().out
    assert main(["results-tables"]) == 0
    assert main(["results-tables", "--check"]) == 0
    text = page.read_text()
    assert text.startswith("Before.\n\n<!-- table: controllers/first -->\n\n| agent | success |\n")
    assert text.endswith("commit abc.*\n\n<!-- end of table -->\n\nAfter.\n")
    assert "old" not in text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("\n<!-- table: x -->\n", r"page.md, line 2: the table has no <!-- end of table -->"),
        ("<!-- end of table -->\n", r"page.md, line 1: <!-- end of table --> without its other half"),
        ("<!-- table: x -->\n<!-- table: y -->\n", r"line 2: <!-- table: y --> without its other half"),
        ("<!-- table: z -->\n<!-- end of table -->\n", "page.md, line 1: no z"),
    ],
)
def test_a_marker_that_is_wrong_is_named(tmp_path, text, said):
    def made(name):
        if name == "z":
            raise ConfigError("no z")
        return name

    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(ConfigError, match=said):
        outdated([page], made)
