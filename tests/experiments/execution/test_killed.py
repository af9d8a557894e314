"""A runner killed at any moment, and started again, ends with the very same results, and loses none."""

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.running.versions import REPOSITORY


def command(config, out):
    return [sys.executable, "-m", "experiments", "run", str(config), "--out", str(out), "--jobs", "2"]


def digests(out):
    """Hashes of all results, byte by byte; what tells of time is left out."""
    found = {}
    assert not (out / "runs" / ".attempts").exists()
    reported = [out / name for name in ("results.parquet", "summary.csv", "report.md")]
    for path in [*sorted(out.glob("runs/*/*")), *reported]:
        text = path.read_bytes()
        if path.name.startswith("events.") or path.name in ("timings.json", "log.txt"):
            continue
        if path.name == "report.md":
            text = timeless(text.decode()).encode()
        found[str(path.relative_to(out))] = hashlib.sha256(text).hexdigest()
    return found


def timeless(report):
    """A report without the table of computing times."""
    lines = report.splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("| agent | all runs (s) |"))
    end = next(i for i in range(head, len(lines)) if not lines[i].startswith("|"))
    return "\n".join(lines[:head] + lines[end:])


def start(config, out):
    return subprocess.Popen(
        command(config, out),
        cwd=REPOSITORY,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "RESULTS_IN": str(out)},  # by which all that it starts is known
    )


def workers(out):
    """Processes that were started to work in the folder, and still run."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"RESULTS_IN={out}".encode() in entry.read_bytes():
                found.append(int(entry.parent.name))
        except OSError:
            continue
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kills", [3, 50])
def test_killed_and_started_again_it_ends_with_the_same(suite_data, write_config, tmp_path, kills):
    suite_data["agents"] = [{"name": "unified_servo"}, {"name": "grid_table"}]
    suite_data["scenarios"][0]["motions"] = 300
    roll = {"do": {"type": "camera_roll"}, "vary": "degrees", "over": [-90, 0, 90]}
    suite_data["sweeps"] = [{"name": "rolled", "env": suite_data["scenarios"][0]["env"], **roll}]
    config = write_config(suite_data)
    undisturbed = tmp_path / "undisturbed"
    begun = time.monotonic()
    subprocess.run(command(config, undisturbed), cwd=REPOSITORY, check=True, capture_output=True)
    whole = time.monotonic() - begun
    rng = random.Random(0)
    out, killed = tmp_path / "killed0", 0
    wanted = digests(undisturbed)
    while killed < kills:
        process = start(config, out)
        try:
            process.wait(rng.uniform(0.1, whole))
        except subprocess.TimeoutExpired:
            killed += 1
            if rng.random() < 0.5:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()  # its workers are left behind
            process.wait()
            continue
        assert process.returncode == 0
        assert digests(out) == wanted
        out = tmp_path / f"killed{killed}"
    subprocess.run(command(config, out), cwd=REPOSITORY, check=True, capture_output=True)
    assert digests(out) == wanted
    assert not workers(tmp_path)
