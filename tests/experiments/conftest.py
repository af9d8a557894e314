"""A comparison of seconds, a place to write it, and its results."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from experiments.__main__ import main
from experiments.config.loading import load
from experiments.errors import ConfigError
from tests.experiments.fakes import AIM


def tiny_suite() -> dict[str, Any]:
    return {
        "name": "tiny",
        "question": "Does <it> run?",
        "seed": 1,
        "worlds": 2,
        "scenarios": [
            {
                "name": "aimed",
                "env": {
                    "id": "CalFree/ReachDense-v0",
                    "world": "wild",
                    "camera_mount": "waist",
                    "tolerance_px": 4.0,
                    "dynamics": "kinematic",
                    "max_episode_steps": 20,
                },
                "motions": 90,
                "perturbations": [{"at": {"motion": 50}, "do": {**AIM}}],
            }
        ],
        "evaluation": {"every": 40, "trials": 2},
        "agents": [{"name": "random"}, {"name": "unified_servo"}],
    }


@pytest.fixture
def suite_data() -> dict[str, Any]:
    """A comparison of seconds, as it stands in YAML."""
    return tiny_suite()


@pytest.fixture
def write_config(tmp_path: Path) -> Callable[[Any], Path]:
    """Writes data (or text) as a YAML file, and returns its path."""

    def write(data: Any) -> Path:
        path = tmp_path / "suite.yaml"
        path.write_text(data if isinstance(data, str) else yaml.safe_dump(data), encoding="utf-8")
        return path

    return write


@pytest.fixture
def refused(write_config: Callable[[Any], Path]) -> Callable[..., str]:
    """Says what is wrong with a suite, or what else is loaded, given as data or text."""

    def refused(data: Any, *overrides: str, load: Callable[..., Any] = load) -> str:
        with pytest.raises(ConfigError) as error:
            load(write_config(data), overrides)
        return str(error.value)

    return refused


@pytest.fixture(scope="session")
def finished_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of `suite_data`, made once; only to be read."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "suite.yaml").write_text(yaml.safe_dump(tiny_suite()), encoding="utf-8")
    out = folder / "out"
    assert main(["run", str(folder / "suite.yaml"), "--out", str(out), "--jobs", "2"]) == 0
    return out


@pytest.fixture
def finished(
    finished_once: Path, suite_data: dict[str, Any], write_config: Callable[[Any], Path], tmp_path: Path
) -> tuple[Path, Path]:
    """A configuration, and a copy of its results that a test may change."""
    return write_config(suite_data), shutil.copytree(finished_once, tmp_path / "out")
