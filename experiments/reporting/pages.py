"""Sections of text, tables, figures and code, as an HTML or a Markdown page."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from experiments.reporting.tables import Table
from experiments.statistics import Estimate

SummaryRow = dict[str, Any]
"""A number of the report: scenario, table, agent, moment, measure, value, low, high and n."""

_CSS = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1c1c1c; max-width: 62rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; }
h1 + p { font-size: 1.15rem; color: #444; margin-top: .3rem; }
svg { width: 100%; height: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid #ddd;
         vertical-align: top; }
pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; font-size: .85rem; }
.note { color: #555; font-size: .9rem; }
.alarming { border: 3px solid #b00020; padding: 0 1rem; }
.alarming h2 { color: #b00020; }
"""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page.

    Attributes:
        title: Heads it.
        text: Stands below the title.
        figures: SVG texts by the name of their file.
        table: Stands below the figures.
        note: How to read figures and table.
        code: Stands at the end.
        alarming: Whether the reader must see it first.
        summary: The numbers of the table and their intervals, one a row; see `report.write_summary`.
    """

    title: str
    text: str = ""
    figures: dict[str, str] = field(default_factory=dict)
    table: Table | None = None
    note: str = ""
    code: str = ""
    alarming: bool = False
    summary: list[SummaryRow] = field(default_factory=list)


def summary_row(
    scenario: str, table: str, agent: str, moment: str, measure: str, found: Estimate | float | None, n: int
) -> SummaryRow:
    """A number of the report with its interval, if it has one.

    Args:
        scenario: Name of the scenario or sweep.
        table: Which of the report's tables: "held_out", "by_trial" or "sweep".
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


def html_page(title: str, question: str, sections: Sequence[Section]) -> str:
    """One page that needs no other file and no script."""
    body = "\n".join(_html_section(section) for section in sections)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(title)}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<p>{escape(question)}</p>\n{body}\n</body>\n</html>\n"
    )


def markdown_page(title: str, question: str, sections: Sequence[Section]) -> str:
    """The same as Markdown; the figures are linked."""
    parts = [f"# {title}", question]
    for section in sections:
        parts.append(f"## {section.title}")
        if section.text:
            parts.append(section.text)
        parts += [f"![{name}](figures/{name}.png)" for name in section.figures]
        if section.table:
            parts.append(section.table.markdown())
        if section.note:
            parts.append(section.note)
        if section.code:
            parts.append(f"```\n{section.code.rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def _html_section(section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    if section.text:
        parts.append(f"<p>{escape(section.text)}</p>")
    for name, svg in section.figures.items():
        drawing = svg[svg.index("<svg") :]
        parts.append(f'<figure role="img" aria-label="{escape(name)}">{drawing}</figure>')
    if section.table:
        parts.append(_html_table(section.table))
    if section.note:
        parts.append(f'<p class="note">{escape(section.note)}</p>')
    if section.code:
        parts.append(f"<pre>{escape(section.code)}</pre>")
    kind = ' class="alarming"' if section.alarming else ""
    return f"<section{kind}>\n" + "\n".join(parts) + "\n</section>"


def _html_table(table: Table) -> str:
    header = "".join(f"<th>{escape(text)}</th>" for text in table.header)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in table.rows
    )
    return f"<table>\n<thead><tr>{header}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
