"""A film of seconds."""

import pytest


@pytest.fixture
def film_data():
    """A film of seconds, as it stands in YAML; the knock comes in the first trial."""
    env = {"id": "CalFree/Reach-v0", "world": "wild", "camera_mount": "stand", "dynamics": "kinematic"}
    return {
        "agent": "unified_servo",
        "env": {**env, "max_episode_steps": 4},
        "seed": 1,
        "trials": 2,
        "perturbations": [
            {"at": {"motion": 2}, "do": {"type": "camera_aim", "camera": "left", "degrees": 15}}
        ],
        "height": 156,
        "width": 216,
        "frames_per_second": 8,
        "gif": {"width": 120, "frames_per_second": 4},
    }
