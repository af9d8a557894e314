"""A page is read on a telephone and on paper, in the dark too, and needs nothing but itself."""

import re
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from PIL import Image

from experiments.reporting.figures import save, say
from experiments.reporting.pages import Head, Section, html_page, markdown_page
from experiments.reporting.tables import Table


class Parsed(HTMLParser):
    """Tags in order, of each table how many columns it has, and what it stands in."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.tables, self._open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag == "table":
            self.tables.append({"columns": 0, "in": list(self._open)})
        if tag == "th":
            self.tables[-1]["columns"] += 1
        if tag in ("div", "details", "section"):
            self._open.append(dict(attributes).get("class", tag))

    def handle_endtag(self, tag):
        if tag in ("div", "details", "section"):
            self._open.pop()


@pytest.fixture(scope="session")
def page(finished_once):
    return (finished_once / "report.html").read_text()


def test_the_page_fits_a_telephone_and_paper_and_loads_nothing(page):
    parsed = Parsed(page)
    assert ("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}) in parsed.tags
    assert "@media print" in page
    assert "prefers-color-scheme: dark" in page
    assert not {"script", "link", "img", "iframe"} & {tag for tag, _ in parsed.tags}
    assert not re.search(r"url\((?!#)|@import", page)


def test_one_table_is_seen_at_once_and_all_others_are_folded(page):
    first, *others = Parsed(page).tables
    assert first == {"columns": 5, "in": ["box"]}
    assert len(others) > 6
    assert all(table["columns"] <= 5 and "details" in table["in"] for table in others)


def test_no_panel_is_wider_than_a_telephone_at_a_size_that_can_be_read(page):
    least = [float(px) for px in re.findall(r"<svg style=\"min-width: ([\d.]+)px", page)]
    assert len(least) == 2
    assert max(least) <= 390 - 2 * 16


def test_no_two_sections_have_one_anchor(page):
    names = [attributes["id"] for tag, attributes in Parsed(page).tags if tag == "div" and "id" in attributes]
    assert len(set(names)) == len(names) > 6


def test_a_figure_comes_in_pieces(tmp_path):
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
    left.plot([0, 1], label="servo")
    right.plot([1, 0], label="servo")
    figure.legend(*left.get_legend_handles_labels(), loc="outside right upper")
    say(figure, "Both", "20 worlds. " * 20)
    drawing = save(figure, tmp_path, "both")
    assert (drawing.title, drawing.said) == ("Both", ("20 worlds. " * 20).strip())
    assert [label for _, label in drawing.legend] == ["servo"]
    widths = [float(re.search(r'width="([\d.]+)pt"', svg)[1]) for svg in drawing.panels]
    assert len(widths) == 2
    assert 5 * 72 < sum(widths) < 8 * 72
    assert {path.name for path in tmp_path.iterdir()} == {"both.png", "both.svg"}


def test_the_head_stands_before_all_sections(tmp_path):
    Image.new("RGB", (4, 4)).save(tmp_path / "film.gif")
    table = Table("t", "T", pd.DataFrame({"a": ["<1>"]}), note="Read it.")
    head = Head("Title", "Why?", {}, table, ["It <works>.", "It lasts."], tmp_path / "film.gif")
    sections = [Section("Broken", text="Mend it.", alarming=True), Section("Two & all", tables=(table,))]
    page = html_page(head, sections)
    seen, _, folded = page.partition("<details>")
    for text in (
        "<h1>Title</h1>",
        "Why?",
        '<td class="number">&lt;1&gt;</td>',
        "Read it.",
        "It &lt;works&gt;.",
    ):
        assert text in seen
    assert 'src="data:image/gif;base64,' in seen
    assert "Mend it." in seen
    assert folded.startswith("\n<summary>Two &amp; all</summary>")
    text = markdown_page(head, sections)
    assert text.startswith(
        "# Title\n\nWhy?\n\n| a |\n| --- |\n| <1> |\n\nRead it.\n\nIt &lt;works>.\n\nIt lasts.\n"
    )
    assert "![An agent at work](film.gif)\n\n## Broken\n\nMend it.\n\n<details>\n<summary>Two & all" in text


def test_markdown_has_no_tags_but_its_own():
    script = "<script>1</script>"
    table = Table("t", script, pd.DataFrame({"a": [script, "a < b"]}), note=script)
    code = Section(script, script, tables=(table, table), code=f"```\n{script}")
    page = markdown_page(Head("suite", script), [code])
    assert page.count("<script>") == 1, "in the code alone"
    assert f"\n````\n```\n{script}\n````\n" in page
    assert "a < b" in page
