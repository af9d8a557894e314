"""What decides whether kept results are of this code."""

import ast
import subprocess

import pytest

from experiments.running import versions
from experiments.running.versions import REPOSITORY, WHAT_MAKES_A_RESULT


def sources(folder):
    """Code, arms, trained weights and tuned settings."""
    kinds = ("*.py", "*.npz", "*.safetensors", "*.xml", "*.yaml")
    return [file for kind in kinds for file in folder.rglob(kind)]


def imported_from(path, seen):
    """Files of `experiments` that a file imports, and what those import."""
    if path not in seen:
        seen.add(path)
        for node in ast.walk(ast.parse((REPOSITORY / path).read_text())):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("experiments."):
                imported_from(node.module.replace(".", "/") + ".py", seen)
    return seen


def test_the_code_that_makes_a_run_is_all_hashed():
    for path in imported_from("experiments/running/worker.py", set()) - {"experiments/errors.py"}:
        assert path.startswith(WHAT_MAKES_A_RESULT), path


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_an_edit_of_any_hashed_file_makes_results_foreign(tmp_path, monkeypatch, every):
    """Of every file; in the shorter tests, of one of each kind in each folder."""
    for root in WHAT_MAKES_A_RESULT:
        path = REPOSITORY / root
        assert path.exists(), root
        for file in [path] if path.is_file() else sources(path):
            write(tmp_path / file.relative_to(REPOSITORY), file.read_bytes())
    monkeypatch.setattr(versions, "REPOSITORY", tmp_path)
    before = versions.versions()["code"]
    files = sources(tmp_path)
    assert len(files) > 80
    for file in files if every else {(file.parent, file.suffix): file for file in files}.values():
        source = file.read_bytes()
        file.write_bytes(source + b"\n")
        assert versions.versions()["code"] != before, file
        file.write_bytes(source)
    assert versions.versions()["code"] == before


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """One with a commit of some code, documents and kept results."""
    for name in ("calfree_gym/a.py", "agents/a.py", "experiments/a.py", "configs/a.yaml", "README.md"):
        write(tmp_path / name, "1")
    write(tmp_path / "experiments" / "results" / "quick" / "summary.csv", "1")
    author = ["-c", "user.name=a", "-c", "user.email=a@example.com"]
    for words in (["init", "--quiet"], ["add", "--all"], [*author, "commit", "--quiet", "-m", "a"]):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    monkeypatch.setattr(versions, "REPOSITORY", tmp_path)
    return tmp_path


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("calfree_gym/a.py", True),
        ("agents/a.py", True),
        ("experiments/a.py", True),
        ("configs/a.yaml", True),
        ("agents/new/file.py", True),
        ("configs/agents/new.yaml", True),
        ("experiments/results/quick/summary.csv", False),
        ("experiments/results/new/summary.csv", False),
        ("README.md", False),
        ("docs/new.md", False),
    ],
)
def test_a_plus_says_that_sources_differ_from_the_commit_or_are_new(repository, name, counts):
    clean = versions.commit()
    assert len(clean) == 12
    write(repository / name, "2")
    assert versions.commit() == clean + "+" * counts


def test_there_is_no_commit_outside_a_repository(tmp_path, monkeypatch):
    monkeypatch.setattr(versions, "REPOSITORY", tmp_path)
    assert versions.commit() == "unknown"
