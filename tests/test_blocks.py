"""What README.md and docs/ show runs as it stands: Python blocks, shell blocks in a copy of all this."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml

from experiments.__main__ import _parser

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(python|shell|yaml)\n(.*?)^```", re.DOTALL | re.MULTILINE)
BLOCKS = {page.relative_to(ROOT).as_posix(): BLOCK.findall(page.read_text()) for page in PAGES}
LONG_COMMANDS = ("run", "film", "tune", "benchmark", "results-tables")
"""Of `python -m experiments`: these are parsed, and their suite is checked; others are carried out."""


FOLDERS = ("calfree_gym", "agents", "experiments", "examples", "docs")


def of(language):
    """The pages that have such blocks."""
    return [page for page, blocks in BLOCKS.items() if any(kind == language for kind, _ in blocks)]


SLOW = {"docs/experience.md": [pytest.mark.slow]}


@pytest.mark.parametrize("page", [pytest.param(page, marks=SLOW.get(page, [])) for page in of("python")])
def test_the_python_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_python(page)


@pytest.mark.slow
@pytest.mark.parametrize("page", of("shell"))
def test_the_commands_of_a_page_run(page, copy, monkeypatch, opengl):
    """After its Python, which may write files for them."""
    monkeypatch.chdir(copy)
    for kind, block in BLOCKS[page]:
        if kind == "yaml" and (named := re.match(r"name: (\w+)", block)):
            (copy / f"{named[1]}.yaml").write_text(block)
    run_python(page)
    for kind, block in BLOCKS[page]:
        if kind == "shell":
            for command in block.replace("\\\n", " ").splitlines():
                carry_out(shlex.split(command, comments=True), copy)


def run_python(page):
    """All its Python, as one program."""
    torch.set_num_threads(1)
    names: dict[str, object] = {}
    for kind, block in BLOCKS[page]:
        if kind == "python":
            exec(compile(block, page, "exec"), names)


def carry_out(words, folder):
    """Runs a command; of what takes long, only what comes before the work. Installing is for test_wheel."""
    if not words or words[:2] in (["pip", "install"], ["git", "clone"]) or words[0] == "cd":
        return
    if words[0] == "make" and words[1] not in ("venv", "compare"):
        words = ["make", "-n", *words[1:]]
    if words[1:3] == ["-m", "experiments"] and words[3] in LONG_COMMANDS:
        options = _parser().parse_args(words[3:])
        if options.command != "run":
            return
        words = [*words[:3], "validate", str(options.config)]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}{done.stderr}"
    if words == ["make", "compare"]:
        assert (folder / "runs/quick/report.html").stat().st_size > 10_000


@pytest.fixture
def copy(tmp_path):
    """The repository, with a short comparison, and what the pages take for granted: an arm, a photograph."""
    folder = tmp_path / "repository"
    for name in ("configs", "arms", ".venv/bin"):
        (folder / name).mkdir(parents=True)
    for name in (*FOLDERS, "pyproject.toml", "constraints.txt"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "Makefile").write_text((ROOT / "Makefile").read_text())
    for path in (ROOT / "configs").iterdir():
        (folder / "configs" / path.name).symlink_to(path)
    for program in ("python", "pytest", "ruff", "mypy"):
        link = Path(sys.executable).with_name(program)
        (folder / ".venv/bin" / program).write_text(f'#!/bin/sh\nexec {shlex.quote(str(link))} "$@"\n')
        (folder / ".venv/bin" / program).chmod(0o755)
    (folder / ".venv/up-to-date").touch()

    quick = yaml.safe_load((ROOT / "configs/quick.yaml").read_text())
    (scenario,) = quick["scenarios"]
    scenario["motions"] = 60
    scenario["perturbations"][0]["at"] = {"motion": 30}
    quick |= {"worlds": 1, "evaluation": {"every": 30, "trials": 2}, "agents": ["paper_servo", "memory"]}
    (folder / "configs/quick.yaml").unlink()
    (folder / "configs/quick.yaml").write_text(yaml.safe_dump(quick))

    (folder / "arms/mine.xml").symlink_to(ROOT / "tests/arms/models/hobby.xml")
    photo = np.full((480, 640, 3), 200, np.uint8)
    cv2.circle(photo, (322, 232), 10, (40, 180, 40), -1, cv2.LINE_AA)
    cv2.imwrite(str(folder / "photo.png"), photo)
    return folder
