"""Servos among mistaken, missing, late and noisy image points."""

from itertools import product

import gymnasium as gym
import numpy as np
import pytest

from agents.base.observation import Observation
from agents.servo.trial import Findings
from agents.servo.unified import UnifiedServo
from calfree_gym import MOUNTS

HARD = {
    "clean": (None, 60, 4.0, 0.995),
    "outliers": ({"type": "point_outliers", "share": 0.4}, 120, 4.0, 0.97),
    "dropout": ({"type": "point_dropout", "share": 0.3}, 60, 4.0, 0.985),
    "latency": ({"type": "latency", "motions": 1}, 60, 4.0, 0.985),
    "some noise": ({"type": "point_noise", "px": 4.0}, 60, 2.5, 0.95),
    "noise": ({"type": "point_noise", "px": 20.0}, 60, 14.5, 0.85),
}
"""What is done to image points, motions, the true error that is asked for, and in which share of worlds."""


def after(mount, trouble, motions, worlds, servo):
    """True errors, and what was found out, after so many motions in wild worlds; nothing ends a trial."""
    trouble = trouble and [{"at": {"trial": 0}, "do": trouble}]
    endless = {"terminate_on_success": False, "autoreset_mode": "Disabled", "max_episode_steps": motions}
    made = {"camera_mount": mount, "dynamics": "kinematic", "perturbations": trouble, **endless}
    env = gym.make_vec("CalFree/Reach-v0", num_envs=worlds, **made)
    observations, _ = env.reset(seed=list(range(3000, 3000 + worlds)))
    findings = [Findings(servo.new_estimator(3, None)) for _ in range(worlds)]
    words, running = np.zeros((worlds, 3), np.float32), []
    for row in range(worlds):
        running.append(servo(of_row(observations, row), findings[row]))
        words[row] = next(running[row])
    for _ in range(motions):
        observations, *_, info = env.step(words)
        for row in range(worlds):
            words[row] = running[row].send(of_row(observations, row))
    return info["truth"]["error_px"], findings


def of_row(observations, row):
    return Observation.of({key: value[row] for key, value in observations.items()})


@pytest.mark.parametrize(
    ("trouble", "mount", "worlds"),
    [
        *[("dropout", "stand", 30), ("some noise", "stand", 30)],
        *[pytest.param(*each, 600, marks=pytest.mark.slow) for each in product(HARD, MOUNTS)],
    ],
)
def test_the_servo_arrives_and_stays_whatever_observations_are_like(trouble, mount, worlds):
    do, motions, error_px, share = HARD[trouble]
    errors_px, _ = after(mount, do, motions, worlds, UnifiedServo())
    assert np.mean(errors_px <= error_px + 1.5) >= (share if worlds > 100 else 0.9)


def test_among_mistaken_points_it_hardly_ever_gives_up_what_it_knows():
    do, motions, *_ = HARD["outliers"]
    _, findings = after("waist", do, motions, 40, UnifiedServo())
    assert np.mean([each.given_up for each in findings]) <= 0.05
