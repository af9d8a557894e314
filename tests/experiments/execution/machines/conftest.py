"""Two runs, what they make, compared byte by byte, and a Dask cluster of this machine."""

import json
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from distributed import LocalCluster

from experiments.__main__ import main


def results(out: Path) -> dict[str, bytes]:
    """All files of the servo's runs but those of times."""
    files = [path for path in out.glob("runs/*servo*/*") if not path.name.startswith(("events.", "timings"))]
    return {str(path.relative_to(out)): _without_times(path) for path in files}


def _without_times(path: Path) -> bytes:
    if path.name == "DONE.json":
        done = json.loads(path.read_bytes())
        del done["wall_seconds"], done["cpu_seconds_a_motion"]
        return json.dumps(done).encode()
    return path.read_bytes()


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


@pytest.fixture
def cluster() -> Iterator[LocalCluster]:
    """Two workers, in processes of their own."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    ) as cluster:
        yield cluster
