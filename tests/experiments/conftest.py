"""A comparison of seconds, and a place to write it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml


@pytest.fixture
def suite_data() -> dict[str, Any]:
    """A comparison of seconds, as it stands in YAML."""
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
                "perturbations": [
                    {
                        "at": {"motion": 50},
                        "do": {"type": "camera_aim", "camera": "left", "degrees": 20},
                    }
                ],
            }
        ],
        "evaluation": {"every": 40, "trials": 2},
        "agents": [{"name": "random"}, {"name": "unified_servo"}],
    }


@pytest.fixture
def write_config(tmp_path: Path) -> Callable[[Any], Path]:
    """Writes data (or text) as a YAML file, and returns its path."""

    def write(data: Any) -> Path:
        path = tmp_path / "suite.yaml"
        path.write_text(data if isinstance(data, str) else yaml.safe_dump(data), encoding="utf-8")
        return path

    return write
