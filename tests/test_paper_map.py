"""docs/paper.md: what it names exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAPER = (ROOT / "docs/paper.md").read_text()
REFERENCES = sorted(set(re.findall(r"`([\w/]+\.(?:py|yaml|xml))(?:::([\w.]+))?`", PAPER)))


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


def test_the_line_that_the_map_quotes_is_there():
    (line,) = re.findall(r"`(yield from [^`]+)`", PAPER)
    assert line in source("agents/servo/paper.py", "PaperServo.__call__")
