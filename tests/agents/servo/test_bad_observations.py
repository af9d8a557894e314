"""Servos among mistaken, missing, late and noisy image points."""

import gymnasium as gym
import numpy as np
import pytest

from agents.base.observation import Observation
from agents.servo.paper import PaperServo
from agents.servo.trial import Findings
from agents.servo.unified import UnifiedServo

HARD = {
    "clean": (None, 60, 4.0, 0.995),
    "outliers": ({"type": "point_outliers", "share": 0.4}, 120, 4.0, 0.97),
    "dropout": ({"type": "point_dropout", "share": 0.3}, 60, 4.0, 0.985),
    "latency": ({"type": "latency", "motions": 1}, 60, 4.0, 0.985),
    "some noise": ({"type": "point_noise", "px": 4.0}, 60, 2.5, 0.95),
    "noise": ({"type": "point_noise", "px": 20.0}, 60, 14.5, 0.85),
}
"""What is done to image points, motions, the true error that is asked for, and in which share of worlds."""


def share_reached(mount, trouble, motions, error_px, worlds):
    """Share of wild worlds with so small a true error after the last motion."""
    errors_px, _ = after(mount, trouble, motions, worlds, UnifiedServo())
    return np.mean(errors_px <= error_px + 1.5)


def after(mount, trouble, motions, worlds, servo):
    """True errors, and what was found out, after so many motions in wild worlds; nothing ends a trial."""
    env = gym.make_vec(
        "CalFree/Reach-v0",
        num_envs=worlds,
        camera_mount=mount,
        dynamics="kinematic",
        max_episode_steps=motions,
        terminate_on_success=False,
        autoreset_mode="Disabled",
        perturbations=trouble and [{"at": {"trial": 0}, "do": trouble}],
    )
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


@pytest.mark.slow
@pytest.mark.parametrize("trouble", HARD)
def test_the_servo_arrives_and_stays_whatever_observations_are_like(trouble, mount):
    do, motions, error_px, least = HARD[trouble]
    assert share_reached(mount, do, motions, error_px, worlds=600) >= least


@pytest.mark.parametrize(
    "trouble", [pytest.param("outliers", marks=pytest.mark.slow), "dropout", "some noise"]
)
def test_the_servo_arrives_among_mistaken_missing_and_noisy_points(trouble):
    do, motions, error_px, _ = HARD[trouble]
    assert share_reached("stand", do, motions, error_px, worlds=30) >= 0.9


def test_the_paper_s_servo_finds_out_how_noisy_points_are_in_its_first_trial():
    _, findings = after("waist", {"type": "point_noise", "px": 2.0}, 60, 30, PaperServo())
    known = [each.filter.noise.px for each in findings if each.filter.noise.measured]
    assert len(known) >= 25
    assert 1.6 <= np.median(known) <= 2.4
