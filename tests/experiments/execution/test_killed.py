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

REPOSITORY = Path(__file__).parents[3]


def command(config, out):
    return [sys.executable, "-m", "experiments", "run", str(config), "--out", str(out), "--jobs", "2"]


def digests(out):
    """Hashes of all results, byte by byte; what they took is left out."""
    found = {}
    assert not (out / "runs" / ".attempts").exists()
    for path in [*sorted(out.glob("runs/*/*")), out / "results.parquet", out / "report.md"]:
        text = path.read_bytes()
        if path.name.startswith("events.") or path.name == "timings.json":
            continue
        elif path.name == "report.md":
            text = b"\n".join(line for line in text.splitlines() if b"out" not in line and b"| " not in line)
        found[str(path.relative_to(out))] = hashlib.sha256(text).hexdigest()
    return found


def start(config, out):
    return subprocess.Popen(
        command(config, out),
        cwd=REPOSITORY,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def workers(out):
    """Processes that still work in the folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"experiments.running.worker" in words and any(str(out).encode() in word for word in words):
            found.append(int(entry.parent.name))
    return found


def kill_and_start_again(suite_data, write_config, tmp_path, kills):
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


def test_three_kills(suite_data, write_config, tmp_path):
    kill_and_start_again(suite_data, write_config, tmp_path, kills=3)


@pytest.mark.slow
def test_fifty_kills(suite_data, write_config, tmp_path):
    kill_and_start_again(suite_data, write_config, tmp_path, kills=50)
