"""Sections as one HTML page, which is read on a telephone, on a screen and on paper."""

import re
from collections.abc import Sequence
from html import escape

from experiments.reporting.pages.section import Drawing, Section
from experiments.reporting.tables import Table

_CSS = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1c1c1c; background: #fff; max-width: 62rem;
       margin: 1.5rem auto; padding: 0 1rem; overflow-wrap: break-word; }
h1 { margin-bottom: 0; }
h1 + p { font-size: 1.15rem; color: #444; margin-top: .3rem; }
h2 { line-height: 1.25; margin-top: 2.5rem; }
a { color: #00539b; }
nav ul { columns: 18rem; font-size: .9rem; }
.short ul { padding-left: 1.1rem; }
.short > ul > li { margin-bottom: .6rem; }
.box { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
td { white-space: nowrap; }
td.words { white-space: normal; min-width: 16rem; }
th:first-child, td:first-child { position: sticky; left: 0; background: #fff; }
figure { margin: 1.5rem 0; }
figcaption { font-weight: bold; }
.panels { display: flex; flex-wrap: wrap; gap: 1rem; }
.panels > div { flex: 1 1 0; overflow-x: auto; }
.panels svg { display: block; width: 100%; height: auto; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.2rem; font-size: .9rem; }
.legend span { white-space: nowrap; }
.legend svg { vertical-align: middle; }
pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; font-size: .85rem; }
.note { color: #555; font-size: .9rem; }
.alarming { border: 3px solid #b00020; padding: 0 1rem; }
.alarming h2 { color: #b00020; margin-top: 1rem; }
@media print {
  @page { size: A4; margin: 14mm; }
  body { font-size: 10pt; color: #000; max-width: none; margin: 0; padding: 0; }
  a { color: #000; }
  a[href^="http"]::after { content: " (" attr(href) ")"; }
  h2 { margin-top: 1.2rem; break-after: avoid; }
  figure, tr { break-inside: avoid; }
  .box, .panels > div { overflow: visible; }
  .panels { flex-wrap: nowrap; }
  .panels > div, .panels svg { min-width: 0 !important; }
  .legend, .note { font-size: 8pt; }
  table { font-size: 6.5pt; width: 100%; }
  th, td { padding: .15rem .4rem .15rem 0; }
  td, td.words { white-space: normal; min-width: 0; }
  th:first-child, td:first-child { position: static; }
  .note, h1 + p, .alarming h2 { color: #000; }
  pre { white-space: pre-wrap; background: none; padding: 0; font-size: 7pt; }
}
"""
_SMALLEST = 0.7
"""A panel is never drawn smaller than so much of its natural size: below, its words cannot be read."""
_LARGEST = 1.2
_WORDS = 40
"""A cell with more letters may be broken into lines."""
_PIXELS_A_POINT = 4 / 3


def html_page(title: str, question: str, sections: Sequence[Section]) -> str:
    """One page that needs no other file and no script.

    At its head stands what the sections come to, then what they are.
    """
    named = [(_anchor(i, section), section) for i, section in enumerate(sections)]
    body = "\n".join([_short(named), _contents(named), *(_section(name, each) for name, each in named)])
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<p>{escape(question)}</p>\n{body}\n</body>\n</html>\n"
    )


_Named = Sequence[tuple[str, Section]]


def _anchor(index: int, section: Section) -> str:
    words = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-")
    return f"{index + 1}-{words}"


def _short(named: _Named) -> str:
    points = []
    for anchor, section in named:
        if section.said:
            lines = "".join(f"<li>{escape(sentence)}</li>" for sentence in section.said)
            points.append(f"<li>{_link(anchor, section)}\n<ul>{lines}</ul></li>")
    lines = "\n".join(points)
    return f'<section class="short">\n<h2>In short</h2>\n<ul>\n{lines}\n</ul>\n</section>' if points else ""


def _contents(named: _Named) -> str:
    lines = "\n".join(f"<li>{_link(anchor, section)}</li>" for anchor, section in named)
    return f"<nav>\n<h2>Contents</h2>\n<ul>\n{lines}\n</ul>\n</nav>"


def _link(anchor: str, section: Section) -> str:
    return f'<a href="#{anchor}">{escape(section.title)}</a>'


def _section(anchor: str, section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    if section.text:
        parts.append(f"<p>{escape(section.text)}</p>")
    parts += [_figure(name, drawing) for name, drawing in section.figures.items()]
    if section.table:
        parts.append(_table(section.table))
    if section.note:
        parts.append(f'<p class="note">{escape(section.note)}</p>')
    if section.code:
        parts.append(f"<pre>{escape(section.code)}</pre>")
    kind = ' class="alarming"' if section.alarming else ""
    return f'<section id="{anchor}"{kind}>\n' + "\n".join(parts) + "\n</section>"


def _figure(name: str, drawing: Drawing) -> str:
    parts = [f"<figcaption>{escape(drawing.title)}</figcaption>"] if drawing.title else []
    panels = "\n".join(_panel(svg) for svg in drawing.panels)
    parts.append(f'<div class="panels" role="img" aria-label="{escape(name)}">\n{panels}\n</div>')
    if drawing.legend:
        lines = "\n".join(f"<span>{_inline(svg)} {escape(label)}</span>" for svg, label in drawing.legend)
        parts.append(f'<div class="legend">\n{lines}\n</div>')
    if drawing.said:
        parts.append(f'<p class="note">{escape(drawing.said)}</p>')
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


def _table(table: Table) -> str:
    header = "".join(f"<th>{escape(text)}</th>" for text in table.header)
    rows = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    inside = f"<table>\n<thead><tr>{header}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
    return (
        f'<div class="box" tabindex="0" role="region" aria-label="{escape(table.title)}">\n{inside}\n</div>'
    )


def _cell(text: str) -> str:
    kind = ' class="words"' if len(text) > _WORDS else ""
    return f"<td{kind}>{escape(text)}</td>"
