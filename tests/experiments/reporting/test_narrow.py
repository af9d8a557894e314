"""Wide tables come in parts that a page shows without scrolling."""

import pandas as pd

from experiments.reporting.pages.narrow import MOST_COLUMNS, narrow
from experiments.reporting.tables import Table


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
    table = wide(
        agent=["a", "a"],
        known=["noise", "noise"],
        mount=["waist", "stand"],
        **{f"x{i}": [1, 1] for i in range(5)},
    )
    assert [part.rows[1][0] for part in narrow(table)] == ["a, stand"] * 2


def test_an_interval_stands_beside_its_number():
    table = wide(agent=["a", "b"], share=[0.5, 0.25], **{"share, 95 %": ["[25, 75] %", ""]})
    (part,) = narrow(table)
    assert part.header == ["agent", "share"]
    assert part.rows == [["a", "50 % [25, 75] %"], ["b", "25 %"]]
