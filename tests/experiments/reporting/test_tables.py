"""Tables: the same cells on a terminal, as Markdown and as JSON."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from experiments.reporting import tables
from experiments.reporting.tables import MOST_COLUMNS, Table, drawn, narrow, number, percent, show
from experiments.statistics import Estimate


@pytest.fixture
def table():
    frame = pd.DataFrame(
        {
            "agent": ["a|b", "[red]c[/red]"],
            "success": [np.float64(0.994), 1.0],
            "bytes": np.array([12_000, 5]),
            "required": [0.99, None],
        }
    )
    formats = {"success": ".1%", "bytes": ",d", "required": ".0%"}
    return Table("reached", "What was reached", frame, formats, "A note.")


def test_cells_are_written_in_the_format_of_their_column_and_do_not_end_early(table):
    assert table.markdown().splitlines() == [
        "| agent | success | bytes | required |",
        "| --- | --- | --- | --- |",
        "| a\\|b | 99.4 % | 12,000 | 99 % |",
        "| [red]c[/red] | 100.0 % | 5 |  |",
    ]


def test_a_table_comes_back_from_json(table):
    text = json.dumps(table.to_dict(), allow_nan=False)
    again = Table.from_dict(json.loads(text))
    assert again.markdown() == table.markdown()
    assert (again.name, again.title, again.note) == (table.name, table.title, table.note)
    assert again.to_dict() == table.to_dict()


def test_a_terminal_draws_what_a_file_gets_as_markdown(table, monkeypatch, capsys):
    show([table])
    markdown = capsys.readouterr().out
    assert markdown == f"### What was reached\n\n{table.markdown()}\n\nA note.\n\n"
    seen = io.StringIO()
    monkeypatch.setattr(tables, "Console", lambda: Console(file=seen, force_terminal=True, width=100))
    show([table], markdown=True)
    assert capsys.readouterr().out == markdown
    show([table])
    for text in ("What was reached", "99.4 %", "12,000", "[red]c[/red]", "A note."):
        assert text in seen.getvalue()
    assert "|" not in seen.getvalue().replace("a|b", "")


def test_nothing_is_cut_off_on_a_narrow_terminal(table):
    seen = io.StringIO()
    long = Table("long", "Long", pd.DataFrame({"run": ["x" * 90], "success": [0.5]}), {"success": ".0%"})
    Console(file=seen, width=40).print(drawn(long))
    assert seen.getvalue().count("x") == 90
    assert "50 %" in seen.getvalue()


def test_what_a_stranger_wrote_neither_rules_a_terminal_nor_breaks_a_row(capsys):
    table = Table.of("a", "\x1b]0;mine\x07", ["b"], [["\x1b[2J\nc"]])
    assert "\x1b" not in table.markdown()
    assert table.markdown().count("\n") == 2
    show([replace(table, note="\x1b[31m")])
    assert "\x1b" not in capsys.readouterr().out


def test_a_table_without_rows_has_its_header():
    empty = Table("none", "Nothing", pd.DataFrame(columns=["a", "b"]))
    assert empty.markdown().splitlines() == ["| a | b |", "| --- | --- |"]
    assert drawn(empty).row_count == 0


def test_estimates_stand_with_their_intervals():
    assert percent(Estimate(0.5, 0.251, 0.749)) == "50 % [25 %, 75 %]"
    assert number(Estimate(3.04, 2.5, 4), 2) == "3.04 [2.50, 4.00]"


def wide(**columns):
    return Table("t", "Title", pd.DataFrame(columns), {"share": ".0%"}, "Note.")


def test_no_part_is_wide_and_none_loses_a_cell():
    table = wide(agent=["a", "b"], mount=["waist", "waist"], **{f"x{i}": [i, 10 * i] for i in range(9)})
    parts = narrow(table)
    assert all(len(part.header) <= MOST_COLUMNS for part in parts)
    assert [part.header[0] for part in parts] == ["agent"] * len(parts)
    assert [name for part in parts for name in part.header[1:]] == table.header[1:]
    assert parts[0].rows[1][:3] == ["b", "waist", "0"]
    assert [(part.title, part.note) for part in parts] == [("Title", ""), ("", ""), ("", "Note.")]


def test_what_tells_rows_apart_stands_in_each_part():
    same = {f"x{i}": [1, 1] for i in range(5)}
    table = wide(agent=["a", "a"], known=["noise", "noise"], mount=["waist", "stand"], **same)
    assert [part.rows[1][0] for part in narrow(table)] == ["a, stand"] * 2


def test_an_interval_stands_beside_its_number():
    table = wide(agent=["a", "b"], share=[0.5, 0.25], **{"share, 95 %": ["[25, 75] %", ""]})
    (part,) = narrow(table)
    assert part.header == ["agent", "share"]
    assert part.rows == [["a", "50 % [25, 75] %"], ["b", "25 %"]]
