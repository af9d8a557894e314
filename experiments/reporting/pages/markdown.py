"""Sections as one Markdown page, whose figures are files beside it."""

from collections.abc import Iterable, Sequence

from experiments.reporting.pages.narrow import narrow
from experiments.reporting.pages.section import Head, Section
from experiments.reporting.tables import Table


def markdown_page(head: Head, sections: Sequence[Section]) -> str:
    """The same as the HTML page: the head, then sections that are folded; the figures are linked."""
    parts = [f"# {head.title}", head.question, *_figures(head.figures)]
    parts += [*tables_markdown([head.table] if head.table else []), *head.said]
    if head.film:
        parts.append(f"![An agent at work]({head.film.name})")
    for section in sections:
        body = [section.text, *_figures(section.figures), *tables_markdown(section.tables), section.note]
        if section.code:
            body.append(f"```\n{section.code.rstrip()}\n```")
        parts += _unfolded(section, body) if section.alarming else _folded(section, body)
    return "\n\n".join(part for part in parts if part) + "\n"


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


def _folded(section: Section, body: list[str]) -> list[str]:
    return [f"<details>\n<summary>{section.title}</summary>", *body, "</details>"]


def _unfolded(section: Section, body: list[str]) -> list[str]:
    return [f"## {section.title}", *body]
