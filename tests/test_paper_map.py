"""docs/paper.md: what it names exists, and it leads from README to the line that executes a test motion."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAPER = (ROOT / "docs/paper.md").read_text()
REFERENCES = sorted(set(re.findall(r"`([\w/]+\.(?:py|yaml|xml))(?:::([\w.]+))?`", PAPER)))
SECTIONS = "1 2 2.1 2.2 2.3 3 3.1 3.2 3.3 3.4 3.5 4 4.1 4.2 4.3 5"
PARTS = ("first implementation", "second implementation", "equation (1)", "filling", "recall", "correction")


def defined(tree):
    """The nodes of what a module or class defines, by name; of a class also `self.x`."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {target.id: node for target in targets if isinstance(target, ast.Name)}
    if isinstance(tree, ast.ClassDef):
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                found.setdefault(node.attr, node)
    return found


def source(file, name):
    """The source of `Class.method` or `function` in a file."""
    text = (ROOT / file).read_text()
    node = ast.parse(text)
    for part in name.split("."):
        node = defined(node)[part]
    return ast.get_source_segment(text, node)


def test_references_are_found():
    assert len(REFERENCES) > 50


@pytest.mark.parametrize(("file", "name"), REFERENCES, ids=["::".join(r).rstrip(":") for r in REFERENCES])
def test_what_the_map_names_exists(file, name):
    assert (ROOT / file).is_file()
    if name:
        assert source(file, name)


@pytest.mark.parametrize("wrong", ["PaperServo.run", "Servo", "PaperServo.redundancies"])
def test_a_wrong_name_is_noticed(wrong):
    with pytest.raises(KeyError):
        source("agents/servo/paper.py", wrong)


def test_every_section_of_the_paper_stands_in_the_map():
    headings = re.findall(r"^#+ ([\d.]+) ", PAPER, re.MULTILINE)
    assert " ".join(headings) == SECTIONS
    for part in PARTS:
        assert part in PAPER, part


def test_three_steps_lead_from_readme_to_a_test_motion():
    """README -> docs/paper.md -> the function -> its line."""
    readme = (ROOT / "README.md").read_text()
    assert "](docs/paper.md)" in readme
    beginning = PAPER[: PAPER.index("## 1 ")]
    (line,) = re.findall(r"`(yield from [^`]+)`", beginning)
    file, name = re.search(r"`([\w/]+\.py)::([\w.]+)`", beginning).groups()
    assert (file, name) == ("agents/servo/paper.py", "PaperServo.__call__")
    assert line in source(file, name)
    assert "](agents/servo/paper.py)" in readme
    assert "yield from self.move(words)" in source("agents/servo/trial.py", "Trial.test")
