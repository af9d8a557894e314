"""Wide tables as narrow ones, which a page shows without scrolling."""

from dataclasses import replace

import numpy as np
import pandas as pd

from experiments.reporting.tables import Table

MOST_COLUMNS = 5
_INTERVAL = ", 95 %"
"""How the name of a column ends that has the intervals of the one before; see `tables.beside`."""


def narrow(table: Table) -> list[Table]:
    """The table in parts of at most five columns; each begins with what names the rows.

    Intervals stand beside their numbers. The title stands above the
    first part, and the note below the last.
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
