"""`python -m tests.mutants [--jobs 2] [--only NAME]`: does a test notice each of the edits in mutants.yaml?

Each job works on a copy of the repository in a temporary folder; the checkout is never edited.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from tests.mutants.mutant import ROOT, Mutant, mutants

LEFT_OUT = (".git", ".venv", "__pycache__", ".*_cache", "runs", "results", "site", "dist", "build")
FAILED, BROKEN = 1, 2
"""What pytest exits with where a test failed, and where one could not even be collected."""
SECONDS = 180
"""A mutant whose tests take longer counts as not noticed: its tests are to fail, not to hang."""
NOTICED, SURVIVED = "noticed", "SURVIVED"


def main() -> int:
    """Tries all mutants; 0 where every one was noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--jobs", type=int, default=2, help="how many are tried at once")
    parser.add_argument("--only", action="append", metavar="NAME", help="only this one (may be repeated)")
    arguments = parser.parse_args()
    chosen = mutants()
    if arguments.only:
        unknown = set(arguments.only) - {mutant.name for mutant in chosen}
        if unknown:
            parser.error(f"unknown mutants: {', '.join(sorted(unknown))}")
        chosen = [mutant for mutant in chosen if mutant.name in arguments.only]
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for job in range(arguments.jobs):
            copy = Path(folder) / str(job) / ROOT.name
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*LEFT_OUT))
            copies.put(copy)
        first = copies.get()
        named = sorted({test for mutant in chosen for test in mutant.tests})
        if _pytest(first, [*named, "-n", str(arguments.jobs)], quiet=False, seconds=10 * SECONDS) != 0:
            return 1  # where nothing is edited they are to pass
        copies.put(first)
        with ThreadPoolExecutor(arguments.jobs) as pool:
            verdicts = dict(zip(chosen, pool.map(partial(_verdict, copies), chosen), strict=True))
    bad = [f"{mutant.name}: {verdict}" for mutant, verdict in verdicts.items() if verdict != NOTICED]
    print(f"\n{len(chosen) - len(bad)} of {len(chosen)} noticed in {time.monotonic() - start:.0f} s")
    print("\n".join(bad))
    return 1 if bad else 0


def _verdict(copies: SimpleQueue[Path], mutant: Mutant) -> str:
    """What becomes of a mutant in one of the copies."""
    copy, start = copies.get(), time.monotonic()
    try:
        verdict = _tried(mutant, copy)
    finally:
        copies.put(copy)
    print(f"{verdict:<16} {time.monotonic() - start:5.1f} s  {mutant.name} ({mutant.file})", flush=True)
    return verdict


def _tried(mutant: Mutant, copy: Path) -> str:
    """Edits the copy, runs the tests, and undoes the edit."""
    path = copy / mutant.file
    original = path.read_text(encoding="utf-8")
    try:
        path.write_text(mutant.applied(original), encoding="utf-8")
    except ValueError:
        return "does not apply"
    try:
        code = _pytest(copy, ["-x", *mutant.tests], quiet=True, seconds=SECONDS)
    finally:
        path.write_text(original, encoding="utf-8")
    if code is None:
        return "took too long"
    if code in (FAILED, BROKEN):
        return NOTICED
    return SURVIVED if code == 0 else f"pytest exits with {code}"


def _pytest(copy: Path, arguments: Sequence[str], quiet: bool, seconds: float) -> int | None:
    """What pytest exits with in a copy; None where it takes too long."""
    output = subprocess.DEVNULL if quiet else None
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"},  # edits may look alike
        stdout=output,
        stderr=output,
        start_new_session=True,
    )
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


if __name__ == "__main__":
    sys.exit(main())
