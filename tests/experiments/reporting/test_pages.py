"""A page is read on a telephone and on paper, and needs nothing but itself."""

import re
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from experiments.reporting.pages import Section
from experiments.reporting.pages.html import html_page
from experiments.reporting.pages.markdown import markdown_page
from experiments.reporting.pages.style import save, say
from experiments.reporting.tables import Table


class Parsed(HTMLParser):
    """Tags in order, and of each table the classes of the boxes around it."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.around, self._open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag == "table":
            self.around.append(list(self._open))
        if tag == "div":
            self._open.append(dict(attributes).get("class"))

    def handle_endtag(self, tag):
        if tag == "div":
            self._open.pop()


@pytest.fixture(scope="session")
def page(finished_once):
    return (finished_once / "report.html").read_text()


def test_the_page_fits_a_telephone_and_paper_and_loads_nothing(page):
    parsed = Parsed(page)
    assert ("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}) in parsed.tags
    assert len(parsed.around) > 6
    assert all("box" in around for around in parsed.around)
    assert "@media print" in page
    assert not {"script", "link", "img", "iframe"} & {tag for tag, _ in parsed.tags}
    assert not re.search(r"url\((?!#)|@import", page)


def test_every_link_of_the_page_leads_to_one_of_its_sections(page):
    tags = Parsed(page).tags
    sections = [attributes["id"] for tag, attributes in tags if tag == "section" and "id" in attributes]
    links = [attributes["href"] for tag, attributes in tags if tag == "a"]
    assert len(set(sections)) == len(sections) > 6
    assert {link.removeprefix("#") for link in links} == set(sections)


def test_no_panel_is_wider_than_a_telephone_at_a_size_that_can_be_read(page):
    least = [float(px) for px in re.findall(r"<svg style=\"min-width: ([\d.]+)px", page)]
    assert len(least) == 2
    assert max(least) <= 390 - 2 * 16


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


def test_what_sections_come_to_stands_at_the_head():
    table = Table("t", "T", pd.DataFrame({"a": ["<1>"]}))
    sections = [Section("One & all", said=("It <works>.", "It lasts.")), Section("Two", table=table)]
    page = html_page("title", "why?", sections)
    head = page[: page.index("Contents")]
    assert '<a href="#1-one-all">One &amp; all</a>' in head
    assert "<li>It &lt;works&gt;.</li><li>It lasts.</li>" in head
    assert "Two" not in head
    assert "<td>&lt;1&gt;</td>" in page
    text = markdown_page("title", "why?", sections)
    assert text.startswith(
        "# title\n\nwhy?\n\n## In short\n\n- **One & all**\n    - It <works>.\n    - It lasts.\n"
    )
    assert "In short" not in markdown_page("title", "why?", sections[1:]) + html_page("", "", sections[1:])
