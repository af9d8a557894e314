"""Agents that insert: pegs go in, and axes are found where they are."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.grasp.observation import InsertObservation
from agents.grasp.yoshimi_allen import axis_of, ellipse_centre
from calfree_gym.image import PIXELS_PER_UNIT
from experiments.evaluation import evaluate
from tests.agents.trials import STAND_FIRST

INSERT = "calfree_gym:CalFree/Insert-v0"


@pytest.mark.parametrize("mount", STAND_FIRST)
def test_insert_puts_pegs_into_holes(mount):
    env = gym.make(INSERT, camera_mount=mount)
    for seed in (1200, 1201, 1202):
        (record,) = evaluate(agents.make("insert", env), env, 1, seed)
        assert record.success
        assert record.motions < 40


def test_yoshimi_allen_puts_most_pegs_into_holes():
    env = gym.make(INSERT)
    records = [evaluate(agents.make("yoshimi_allen", env), env, 1, seed)[0] for seed in range(1200, 1206)]
    assert sum(record.success for record in records) >= 3


def test_the_centre_of_an_ellipse_is_found_by_a_part_of_it_and_else_there_is_the_mean():
    angles = np.linspace(0.3, 2.5, 9)
    points = np.array([0.2, -0.1]) + np.stack([0.08 * np.cos(angles), 0.03 * np.sin(angles + 0.4)], -1)
    np.testing.assert_allclose(ellipse_centre(points), [0.2, -0.1], atol=1e-6)
    line = np.stack([np.arange(8.0), np.zeros(8)], -1)
    np.testing.assert_allclose(ellipse_centre(np.ones((8, 2))), [1, 1])
    assert np.isfinite(ellipse_centre(line)).all()
    np.testing.assert_allclose(ellipse_centre(line[:3]), [1, 0])


def test_turning_the_tool_shows_its_axis():
    env = gym.make(INSERT, camera_mount="stand")
    errors = []
    for seed in range(1300, 1308):
        env.reset(seed=seed)
        looks = []
        for _ in range(6):
            raw, *_, info = env.step(np.array([0, 0, 0, 0.15], np.float32))
            looks.append(InsertObservation.of(raw))
        true = info["truth"]["points"].reshape(-1, 2, 2)
        errors.append(PIXELS_PER_UNIT * np.linalg.norm(axis_of(looks) - (true[0] - true[1]), axis=-1))
    assert np.median(errors) < 1.5


def test_yoshimi_allen_bears_a_camera_that_sees_nothing():
    away = {"at": {"trial": 0}, "do": {"type": "camera_aim", "camera": "right", "degrees": 90}}
    env = gym.make(INSERT, perturbations=[away], keep_in_view=False, max_episode_steps=20)
    (record,) = evaluate(agents.make("yoshimi_allen", env), env, 1, seed=3)
    assert record.motions == 20
