"""Two runs, and what they make, compared byte by byte."""

from collections.abc import Callable
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
