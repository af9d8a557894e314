"""docs/paper.md: what it names exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
REFERENCES = re.findall(r"`([\w/]+\.(?:py|yaml|xml))(?:::([\w.]+))?`", (ROOT / "docs/paper.md").read_text())


def names(node):
    """What it is called: a function, a class, a constant, or an attribute that is set."""
    if isinstance(node, ast.Attribute | ast.Name) and not isinstance(node.ctx, ast.Store):
        return None
    return getattr(node, "name", getattr(node, "attr", getattr(node, "id", None)))


@pytest.mark.parametrize(("file", "name"), sorted(set(REFERENCES)), ids="::".join)
def test_what_the_map_names_exists(file, name):
    text = (ROOT / file).read_text()
    within = ast.parse(text) if name else None
    for part in filter(None, name.split(".")):
        within = next(node for node in ast.walk(within) if names(node) == part)
