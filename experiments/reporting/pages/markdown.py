"""Sections as one Markdown page, whose figures are files beside it."""

from collections.abc import Sequence

from experiments.reporting.pages.section import Section


def markdown_page(title: str, question: str, sections: Sequence[Section]) -> str:
    """The same as the HTML page; the figures are linked."""
    parts = [f"# {title}", question]
    points = [
        "\n    - ".join([f"- **{section.title}**", *section.said]) for section in sections if section.said
    ]
    if points:
        parts += ["## In short", "\n".join(points)]
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
