"""What a report is put together from, and how it becomes a Markdown and an HTML page."""

import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from experiments.reporting.tables import Table, narrow
from experiments.statistics import Estimate

PAGE, MARKDOWN = "report.html", "report.md"
SummaryRow = dict[str, Any]
"""A number of the report: scenario, table, agent, moment, measure, value, low, high and n."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure in pieces, which stand side by side where there is room, and else below each other.

    Panels are SVG texts, from left to right; the legend has one of each line or marker, and what it is.
    """

    title: str
    panels: tuple[str, ...]
    legend: tuple[tuple[str, str], ...]
    said: str


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page.

    Attributes:
        figures: By the names of their files.
        tables: Stand below the figures, each under its title where there are several.
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
        figures: The one picture, by the name of its file.
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
    """A number of the report with its interval, if it has one; None where there is no number.

    It stands in one of the report's tables of a scenario or sweep, and is of n trials or worlds. The moment
    is such as "before", trials "1–25", or the value of what a sweep varies.
    """
    value, low, high = (
        (found.value, found.low, found.high) if isinstance(found, Estimate) else (found, None, None)
    )
    where = {"scenario": scenario, "table": table, "agent": agent, "moment": moment, "measure": measure}
    return where | {"value": value, "low": low, "high": high, "n": n}


def markdown_page(head: Head, sections: Sequence[Section]) -> str:
    """The same as the HTML page: the head, then sections that are folded; the figures are linked."""
    parts = [f"# {head.title}", head.question, *_figures(head.figures)]
    parts += [*tables_markdown([head.table] if head.table else []), *head.said]
    if head.film:
        parts.append(f"![An agent at work]({head.film.name})")
    parts = [without_tags(part) for part in parts]
    for section in sections:
        body = [section.text, *_figures(section.figures), *tables_markdown(section.tables), section.note]
        title, *body = [without_tags(text) for text in (section.title, *body)]
        if section.code:
            fence = max(["```", *(f"{run}`" for run in re.findall("`{3,}", section.code))], key=len)
            body.append(f"{fence}\n{section.code.rstrip()}\n{fence}")
        if section.alarming:
            parts += [f"## {title}", *body]
        else:
            parts += [f"<details>\n<summary>{title}</summary>", *body, "</details>"]
    return "\n\n".join(part for part in parts if part) + "\n"


def without_tags(text: str) -> str:
    """Markdown without HTML: texts are of whoever wrote the suite."""
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", text)


def tables_markdown(tables: Sequence[Table]) -> list[str]:
    """Tables of at most five columns with their notes, each under its title where there are several."""
    titled = len(tables) > 1
    texts = [
        text
        for table in tables
        for part in narrow(table)
        for text in (f"**{part.title}**" if titled and part.title else "", part.markdown(), part.note)
    ]
    return [text for text in texts if text]


def _figures(names: Iterable[str]) -> list[str]:
    return [f"![{name}](figures/{name}.png)" for name in names]


_CSS = Path(__file__).with_name("page.css")
_SMALLEST = 0.7
"""A panel is never drawn smaller than so much of its natural size: below, its words cannot be read."""
_LARGEST = 1.2
_NUMBER = 16
"""A cell with a digit and at most so many letters is a number."""
_PIXELS_A_POINT = 4 / 3


def html_page(head: Head, sections: Sequence[Section]) -> str:
    """One page that needs no other file and no script.

    Its head is read in a minute; the sections below are folded, but those that alarm.
    """
    body = "\n".join([_head(head), *(_section(i, each) for i, each in enumerate(sections, 1))])
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(head.title)}</title>\n<style>\n{_CSS.read_text()}</style>\n</head>\n<body>\n"
        f"{body}\n</body>\n</html>\n"
    )


def _head(head: Head) -> str:
    parts = [f"<h1>{escape(head.title)}</h1>\n<p>{escape(head.question)}</p>"]
    parts += [_figure(name, drawing) for name, drawing in head.figures.items()]
    parts += _tables([head.table] if head.table else [])
    parts += [f"<p>{escape(sentence)}</p>" for sentence in head.said]
    if head.film:
        data = b64encode(head.film.read_bytes()).decode()
        kind = head.film.suffix.removeprefix(".")
        parts.append(f'<img alt="An agent at work" src="data:image/{kind};base64,{data}">')
    return "\n".join(parts)


def _section(index: int, section: Section) -> str:
    parts = [f"<p>{escape(section.text)}</p>"] if section.text else []
    parts += [_figure(name, drawing) for name, drawing in section.figures.items()]
    parts += _tables(section.tables)
    parts.append(_note(section.note))
    if section.code:
        parts.append(f"<pre>{escape(section.code)}</pre>")
    title, body = escape(section.title), "\n".join(part for part in parts if part)
    if section.alarming:
        return f'<section class="alarming">\n<h2>{title}</h2>\n{body}\n</section>'
    words = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-")
    inside = f'<div id="{index}-{words}">\n{body}\n</div>'
    return f"<details>\n<summary>{title}</summary>\n{inside}\n</details>"


def _figure(name: str, drawing: Drawing) -> str:
    parts = [f"<figcaption>{escape(drawing.title)}</figcaption>"] if drawing.title else []
    panels = "\n".join(_panel(svg) for svg in drawing.panels)
    parts.append(f'<div class="panels" role="img" aria-label="{escape(name)}">\n{panels}\n</div>')
    if drawing.legend:
        lines = "\n".join(f"<span>{_inline(svg)} {escape(label)}</span>" for svg, label in drawing.legend)
        parts.append(f'<div class="legend">\n{lines}\n</div>')
    parts.append(_note(drawing.said))
    return "<figure>\n" + "\n".join(parts) + "\n</figure>"


def _panel(svg: str) -> str:
    """A box that grows with its panel's width, and in which the panel is scrolled where room is scarce."""
    found = re.search(r'<svg [^>]*width="([\d.]+)pt"', svg)
    width = float(found[1]) * _PIXELS_A_POINT if found else 0.0
    least = f"{_SMALLEST * width:.0f}px"
    drawn = _inline(svg).replace("<svg ", f'<svg style="min-width: {least}" ', 1)
    sizes = f"flex-grow: {width:.0f}; min-width: min(100%, {least}); max-width: {_LARGEST * width:.0f}px"
    return f'<div style="{sizes}">{drawn}</div>'


def _inline(svg: str) -> str:
    return svg[svg.index("<svg") :].rstrip()


def _tables(tables: Sequence[Table]) -> list[str]:
    """Tables of at most five columns with their notes, each under its title where there are several."""
    titled = len(tables) > 1
    return [
        text
        for table in tables
        for part in narrow(table)
        for text in (_table(part, table.title, titled), _note(part.note))
        if text
    ]


def _note(text: str) -> str:
    return f'<p class="note">{escape(text)}</p>' if text else ""


def _table(table: Table, title: str, titled: bool) -> str:
    caption = f"<caption>{escape(table.title)}</caption>\n" if titled and table.title else ""
    header = "".join(f"<th>{_broken(text)}</th>" for text in table.header)
    rows = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    inside = f"<table>\n{caption}<thead><tr>{header}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
    return f'<div class="box" tabindex="0" role="region" aria-label="{escape(title)}">\n{inside}\n</div>'


def _cell(text: str) -> str:
    is_number = len(text) <= _NUMBER and any(letter.isdigit() for letter in text)
    kind = ' class="number"' if is_number else ""
    return f"<td{kind}>{_broken(text)}</td>"


def _broken(text: str) -> str:
    """Names of agents may be broken into lines where room is scarce."""
    return escape(text).replace("_", "_<wbr>")
