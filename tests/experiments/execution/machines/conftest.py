"""Two runs, and what they make, compared byte by byte."""

import random
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from experiments.__main__ import main
from experiments.running.results_folder import TIMINGS


def results(out: Path) -> dict[str, bytes]:
    """All files of the servo's runs, but of times: timings.json, and TensorBoard's, which hold moments."""
    files = [
        path
        for path in out.glob("runs/*servo*/*")
        if path.name != TIMINGS and not path.name.startswith("events.")
    ]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def made_anew_until(
    kills: int, make: Callable[[Path], int], kill_one: Callable[[random.Random, Path], bool], tmp_path: Path
) -> Iterator[Path]:
    """Makes the suite anew until so many were killed, at random moments, while it was made.

    Args:
        kills: How many.
        make: Makes it into a folder; returns the exit code, which must be 0.
        kill_one: Kills one of those at work for a folder; whether there was one.
        tmp_path: Holds the folders.

    Yields:
        Each folder.
    """
    rng, killed, tries = random.Random(0), 0, 0
    while killed < kills:
        tries += 1
        assert tries <= 10 + kills, "the suite is over before anything is killed"
        out, over, count = tmp_path / str(tries), threading.Event(), []

        def kill(out: Path = out, over: threading.Event = over, count: list[int] = count) -> None:
            while len(count) < 3 and not over.wait(rng.uniform(0.2, 2.0)):
                if kill_one(rng, out):
                    count.append(1)

        thread = threading.Thread(target=kill)
        thread.start()
        try:
            assert make(out) == 0
        finally:
            over.set()
            thread.join()
        killed += len(count)
        yield out


def assert_nothing_changed(out: Path, finished_once: Path) -> None:
    """All results are those of an undisturbed run, and no attempt is left over."""
    assert results(out) == results(finished_once)
    assert not (out / "runs" / ".attempts").exists()


@pytest.fixture
def suite_data(suite_data: dict[str, Any]) -> dict[str, Any]:
    """Two of the four runs of `finished_once`."""
    return suite_data | {"agents": [{"name": "unified_servo"}]}


@pytest.fixture
def run(write_config: Callable[[Any], Path], suite_data: dict[str, Any]) -> Callable[..., int]:
    """Carries out `suite_data` into a folder, with options."""

    def run(out: Path, *options: object) -> int:
        return main(["run", str(write_config(suite_data)), "--out", str(out), *map(str, options)])

    return run
