"""`make results` makes nothing twice, and keeps nothing that other code has made."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

PYTHON = """#!/bin/sh
if [ "$1" = -c ]; then echo "$COMMIT"; exit; fi
if [ "$2" = experiments ]; then echo "$3 $4" >> log; fi
made=$3; for last; do :; done
if [ "$made" = benchmark ]; then echo "{\\"commit\\": \\"$COMMIT\\"}" > "$last"; fi
"""
"""Stands for the interpreter of `.venv`: answers which commit this is, and writes down what is to be made."""


@pytest.fixture
def made(tmp_path):
    """What `make results` makes at a commit."""
    shutil.copy(Path(__file__).parents[1] / "Makefile", tmp_path)
    for folder in ("bin", "build/results"):
        (tmp_path / folder).mkdir(parents=True)
    for file in ("constraints.txt", "pyproject.toml", ".venv/up-to-date"):  # the last one made last
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).touch()
    (tmp_path / "bin" / "python").write_text(PYTHON)
    (tmp_path / "bin" / "python").chmod(0o755)

    def make(commit):
        (tmp_path / "log").unlink(missing_ok=True)
        command = ["make", "results", "BIN=bin", "SUITES=paper others"]
        subprocess.run(command, cwd=tmp_path, env=os.environ | {"COMMIT": commit}, check=True)
        log = (tmp_path / "log").read_text().splitlines()
        benchmarks = [line for line in log if line.startswith("benchmark")]
        last = [f"benchmark {part}" for part in ALONE] if benchmarks else []
        assert benchmarks[len(SIDE_BY_SIDE) :] == last, "they take all cores, or measure time"
        kept = [line for line in log if line.endswith(".json")]
        parts = sorted((*SIDE_BY_SIDE, *ALONE))
        assert sorted(kept) == [f"keep build/results/{part}.json" for part in parts]
        return [line for line in log if line not in (*benchmarks, *kept)] + sorted(benchmarks)

    return make


SIDE_BY_SIDE = ("coverage", "insert", "orientations", "priors", "safe_start")
ALONE = ("changes", "right_actions", "sensitivity", "speed", "training")


def test_results_are_made_once_for_each_commit(made):
    suites = [
        f"{verb} {where}/{suite}{end}"
        for suite in ("paper", "others")
        for verb, where, end in (("run", "configs", ".yaml"), ("keep", "build/results", ""))
    ]
    benchmarks = sorted(f"benchmark {part}" for part in (*SIDE_BY_SIDE, *ALONE))
    assert made("abc") == [*suites, "results-tables ", *benchmarks]
    assert made("abc") == [*suites, "results-tables "]  # which go on where they were
    assert made("abd") == [*suites, "results-tables ", *benchmarks]
