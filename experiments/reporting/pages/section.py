"""A part of a page: text, tables, figures and code."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.reporting.tables import Table
from experiments.statistics import Estimate

SummaryRow = dict[str, Any]
"""A number of the report: scenario, table, agent, moment, measure, value, low, high and n."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure in pieces, which stand side by side where there is room, and else below each other.

    Attributes:
        title: Stands above.
        panels: SVG texts, from left to right.
        legend: An SVG text of each line or marker, and what it is.
        said: How to read the figure.
    """

    title: str
    panels: tuple[str, ...]
    legend: tuple[tuple[str, str], ...]
    said: str


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page.

    Attributes:
        title: Heads it.
        text: Stands below the title.
        figures: By the names of their files.
        tables: Stand below the figures, each under its title where there are several.
        note: How to read figures and tables.
        code: Stands at the end.
        alarming: Whether the reader must see it first.
        summary: The numbers of the tables and their intervals, one a row; see `report.write_report`.
    """

    title: str
    text: str = ""
    figures: dict[str, Drawing] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    note: str = ""
    code: str = ""
    alarming: bool = False
    summary: list[SummaryRow] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Head:
    """What a page says in a minute.

    Attributes:
        title: Names the suite.
        question: What it asks.
        figures: The one picture, by the name of its file.
        table: The one table.
        said: What the comparison comes to, in sentences.
        film: A GIF or PNG of an agent at work.
    """

    title: str
    question: str
    figures: dict[str, Drawing] = field(default_factory=dict)
    table: Table | None = None
    said: Sequence[str] = ()
    film: Path | None = None


def summary_row(
    scenario: str, table: str, agent: str, moment: str, measure: str, found: Estimate | float | None, n: int
) -> SummaryRow:
    """A number of the report with its interval, if it has one.

    Args:
        scenario: Name of the scenario or sweep.
        table: Which of the report's tables: "held_out", "checkpoints", "profile", "threshold", "comparison",
            "by_trial", "by_arm", "sweep" or "claims".
        agent: The agent's label.
        moment: When: "before", trials "1–25", or the value of what a sweep varies.
        measure: What was measured.
        found: None where there is no number.
        n: How many trials or worlds the number is of.
    """
    value, low, high = (
        (found.value, found.low, found.high) if isinstance(found, Estimate) else (found, None, None)
    )
    where = {"scenario": scenario, "table": table, "agent": agent, "moment": moment, "measure": measure}
    return where | {"value": value, "low": low, "high": high, "n": n}
