"""A table: a DataFrame with a title and a note, on a terminal, as Markdown or JSON; how cells are written."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import pandas as pd
import rich.box
import rich.table
import rich.text
from rich.console import Console

from calfree_gym.errors import printable
from experiments.statistics import Estimate

NOTHING = "–"
"""A cell in which there is no number."""
MOST_COLUMNS = 5
"""Of a table that a page shows without scrolling."""
_INTERVAL = ", 95 %"
"""How the name of a column ends that has the intervals of the one before; see `beside`."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows and columns, with what a reader needs to understand them.

    Attributes:
        name: Names the table in kept files and in the markers of pages.
        frame: One row a line, numbers as numbers.
        formats: How the numbers of a column are written, such as ".1%" or ",.0f"; others as they are.
    """

    name: str
    title: str
    frame: pd.DataFrame
    formats: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    @classmethod
    def of(cls, name: str, title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> Self:
        """A table of such rows."""
        return cls(name, title, pd.DataFrame(rows, columns=list(columns)))

    @property
    def header(self) -> list[str]:
        """The names of the columns."""
        return [str(column) for column in self.frame.columns]

    @property
    def rows(self) -> list[list[str]]:
        """The cells as text; what is missing is empty."""
        columns = [
            [written(cell, self.formats.get(str(name), "")) for cell in self.frame[name]]
            for name in self.frame.columns
        ]
        return [list(row) for row in zip(*columns, strict=True)]

    def markdown(self) -> str:
        """The rows as a Markdown table."""
        rows = [self.header, ["---"] * len(self.header), *self.rows]
        return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)

    def to_dict(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        return {
            "name": self.name,
            "title": self.title,
            "columns": self.header,
            "rows": [[_plain(cell) for cell in row] for row in self.frame.itertuples(index=False)],
            "formats": dict(self.formats),
            "note": self.note,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """What `to_dict` returned."""
        frame = pd.DataFrame(data["rows"], columns=data["columns"], dtype=object)
        return cls(data["name"], data["title"], frame, data["formats"], data["note"])


def narrow(table: Table) -> list[Table]:
    """The table in parts of at most five columns; each begins with what names the rows.

    Intervals stand beside their numbers. The title stands above the first part, the note below the last.
    """
    cells = _with_intervals(table)
    if len(cells.columns) <= MOST_COLUMNS:
        return [replace(table, frame=cells, formats={})]
    names, rest = _named(cells)
    count = -(-len(rest.columns) // (MOST_COLUMNS - 1))
    parts = [rest.iloc[:, part] for part in np.array_split(np.arange(len(rest.columns)), count)]
    first, last = parts[0], parts[-1]
    return [
        replace(
            table,
            title=table.title if part is first else "",
            frame=pd.concat([names, part], axis=1),
            formats={},
            note=table.note if part is last else "",
        )
        for part in parts
    ]


def _with_intervals(table: Table) -> pd.DataFrame:
    """All cells as text, each interval beside its number."""
    cells = pd.DataFrame(table.rows, columns=table.header, dtype=str)
    for name in table.header:
        if name.endswith(_INTERVAL) and (number := name.removesuffix(_INTERVAL)) in cells:
            cells[number] = (cells[number] + " " + cells.pop(name)).str.strip()
    return cells


def _named(cells: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """As one column those of the first ones that tell all rows apart; and all others."""
    names = [cells.columns[0]]
    for name in cells.columns[1:-1]:
        if not cells[names].duplicated().any():
            break
        names.append(name)
    for name in names[1:]:
        fewer = [each for each in names if each != name]
        if not cells[fewer].duplicated().any():
            names = fewer
    together = cells[names].apply(lambda row: ", ".join(filter(None, row)), axis=1)
    return together.to_frame(", ".join(names)), cells.drop(columns=names)


def show(tables: Iterable[Table], markdown: bool = False) -> None:
    """Prints tables: drawn on a terminal, and as Markdown elsewhere or where `markdown` is true."""
    console = Console()
    for table in tables:
        table = replace(table, title=printable(table.title), note=printable(table.note))
        if markdown or not console.is_terminal:
            parts = [f"### {table.title}", table.markdown(), table.note]
            print("\n\n".join(part for part in parts if part), end="\n\n", flush=True)
        else:
            console.print(drawn(table), table.note, markup=False, highlight=False)


def drawn(table: Table) -> rich.table.Table:
    """The table for a terminal, numbers to the right; nothing is cut off where it is narrow."""
    found = rich.table.Table(
        title=rich.text.Text(table.title), title_justify="left", box=rich.box.SIMPLE_HEAD
    )
    for name in table.frame.columns:
        numbers = str(name) in table.formats or pd.api.types.is_numeric_dtype(table.frame[name])
        found.add_column(rich.text.Text(str(name)), justify="right" if numbers else "left", overflow="fold")
    for row in table.rows:
        found.add_row(*(rich.text.Text(cell) for cell in row))
    return found


def percent(estimate: Estimate, digits: int = 0) -> str:
    """A share with its interval, if it has one."""
    return _with_interval(estimate, f".{digits}%")


def number(estimate: Estimate, digits: int = 1) -> str:
    """A number with its interval, if it has one."""
    return _with_interval(estimate, f",.{digits}f")


def _with_interval(estimate: Estimate, form: str) -> str:
    value, low, high = (written(part, form) for part in (estimate.value, estimate.low, estimate.high))
    return f"{value or NOTHING} [{low}, {high}]" if estimate.has_interval else value or NOTHING


def with_most(value: float, most: tuple[float, float], form: str) -> str:
    """A median over worlds, and between which values most worlds lie, such as "3.0 (2.1 – 5.6)"."""
    low, high = (written(edge, form) for edge in most)
    return f"{written(value, form)} ({low} – {high})"


def counted(amount: int, thing: str) -> str:
    """So many things, such as "1 world" and "20 worlds"."""
    return f"{amount:,} {thing}{'s' * (amount != 1)}"


def beside(name: str, found: Estimate, form: str) -> dict[str, Any]:
    """A number and, as text in a column of its own, its interval; `form` is such as ".1%"."""
    limits = ", ".join(written(edge, form).removesuffix(" %") for edge in (found.low, found.high))
    interval = f"[{limits}]{' %' if form.endswith('%') else ''}" if found.has_interval else ""
    return {name: found.value, f"{name}{_INTERVAL}": interval}


def must_know(privileged: Sequence[str], prior_knowledge: Sequence[str]) -> str:
    """What an agent must know beyond its observations, as one cell; privileged ones in back-quotes."""
    return ", ".join([*(f"`{observation}`" for observation in privileged), *prior_knowledge]) or "nothing"


def written(cell: Any, form: str) -> str:
    """A cell as text: what is missing is empty, and a per cent sign stands apart."""
    if cell is None or (isinstance(cell, float) and pd.isna(cell)):
        return ""
    if isinstance(cell, float) and math.isinf(cell):
        return "∞" if cell > 0 else "-∞"
    if form and not isinstance(cell, str):
        text = format(cell, form)
        return text.replace("%", " %") if form.endswith("%") else text
    return printable(str(cell)).replace("\n", " ")


def _plain(cell: Any) -> Any:
    """A cell as JSON knows it: no NumPy number, nothing that is not a number."""
    value = cell.item() if hasattr(cell, "item") else cell
    return None if isinstance(value, float) and pd.isna(value) else value
