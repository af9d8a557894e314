"""A million random motions under all perturbations at once."""

import gc
from pathlib import Path

import numpy as np
import pytest

from calfree_gym.perturbations import TYPES
from tests.calfree_gym.environments import OF_ARMS, make

ROWS = 128
STATUS = Path("/proc/self/status")


def resident_megabytes():
    gc.collect()
    (line,) = (line for line in STATUS.read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="reads memory from /proc")
@pytest.mark.parametrize("keep_in_view", [True, False])
def test_half_a_million_random_motions(keep_in_view):
    """Nothing NaN, nothing out of bounds, no memory growth. Out of view, every drift goes on as well."""
    schedule = [{"every": {"motion": 900 + 7 * i}, "do": {"type": name}} for i, name in enumerate(OF_ARMS)]
    if not keep_in_view:
        drifting = [name for name in OF_ARMS if TYPES[name].drifts]
        schedule += [{"drift": {"per": "trial"}, "do": {"type": name}} for name in drifting]
    arguments = {"dynamics": "kinematic", "perturbations": schedule, "keep_in_view": keep_in_view}
    told = ("joint_angles", "joint_zeros", "gripper_position")
    env = make("ReachDense", ROWS, tell=told, **arguments).unwrapped
    rng = np.random.default_rng(0)
    observation, _ = env.reset(seed=0)
    steps = 500_000 // ROWS + 1
    applied = set()
    for step in range(steps):
        for key, value in observation.items():
            space = env.observation_space[key]
            assert (value >= space.low).all(), key  # which no NaN is
            assert (value <= space.high).all(), key
        scale = rng.choice([0.02, 0.3, 1.0])
        words = rng.uniform(-scale, scale, (ROWS, 3)).astype(np.float32)
        observation, rewards, _, _, infos = env.step(words)
        assert np.isfinite(rewards).all()
        assert np.isfinite(infos["robot_seconds"]).all()
        for key in ("error_px", "distance_mm", "points", "gripper", "object", "joints"):
            assert np.isfinite(infos["truth"][key]).all(), key
        applied |= {perturbation.type for of_row in env.applied for perturbation in of_row}
        if step == steps // 5:
            before = resident_megabytes()
    assert applied == set(OF_ARMS)
    assert resident_megabytes() - before < 10
