"""The recipes of CONTRIBUTING.md, followed word for word in a copy of the repository."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
FOLDERS = ("calfree_gym", "agents", "experiments", "docs")
FILES = ("mkdocs.yml", "pyproject.toml", "README.md")
RECIPES = {
    part.splitlines()[0].removeprefix("a ").removeprefix("an "): part
    for part in TEXT.split("\n## Recipe: ")[1:]
}
STEP = re.compile(
    r"^(?P<what>New file|In|Try it)(?: `(?P<file>[^`]+)`)?"
    r"(?:, (?P<where>before|after every|after) (?P<ticks>`+) ?(?P<anchor>.+?) ?(?P=ticks))?:\n\n"
    r"```\w*\n(?P<block>.*?)^```",
    re.MULTILINE | re.DOTALL,
)
BEGINNING = re.compile(r"^(?:New file|In|Try it)\b", re.MULTILINE)


def run(*command, cwd):
    environment = os.environ | {"PYTHONPATH": str(cwd)}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def follow(recipe, folder):
    """Carries out a recipe in a folder."""
    steps = list(STEP.finditer(RECIPES[recipe]))
    assert len(steps) == len(BEGINNING.findall(RECIPES[recipe])), "a step that this test does not understand"
    for step in steps:
        if step["what"] == "Try it":
            shell = step["block"].startswith(".venv/bin/python ")
            command = shlex.split(step["block"])[1:] if shell else ["-c", step["block"]]
            run(sys.executable, *command, cwd=folder)
            continue
        path = folder / step["file"]
        assert path.exists() == (step["what"] == "In")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(inserted(path.read_text(), step) if step["what"] == "In" else step["block"])


def inserted(text, step):
    """A text with a step's block, as far indented as the line it is put beside."""
    lines = text.splitlines(keepends=True)
    places = [i for i, line in enumerate(lines) if line.strip() == step["anchor"]]
    assert len(places) == 1 or (places and step["where"] == "after every"), step["anchor"]
    for at in reversed(places):
        block = textwrap.indent(step["block"], re.match(" *", lines[at])[0])
        lines.insert(at + (step["where"] != "before"), block)
    return "".join(lines)


@pytest.fixture
def copy(tmp_path):
    for name in FOLDERS:
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    where = run(sys.executable, "-c", "import calfree_gym, agents; print(calfree_gym.__file__)", cwd=tmp_path)
    assert where.startswith(str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.slow
def test_recipe(recipe, copy):
    """What it tries runs, and the tests pass that it adds."""
    follow(recipe, copy)
    for test in copy.glob("tests/**/test_*.py"):
        run(sys.executable, "-m", "pytest", "-q", str(test), cwd=copy)
