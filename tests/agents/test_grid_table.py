"""The paper's table against what section 4.2 says of it."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
from agents.knowledge.grid_table import GridTable
from tests.agents.lengths import Lengths

POINT = st.lists(st.floats(-1, 1), min_size=4, max_size=4).map(np.array)
REGISTERS = st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3).map(np.array)


@settings(max_examples=50, deadline=None)
@given(POINT, REGISTERS)
def test_the_first_success_fills_all_sixteen_corners_of_its_cell_and_no_more(sensors, registers):
    table = GridTable(3)
    assert table.recall(sensors) is None
    table.learn(sensors, registers)
    filled = ~np.isnan(table.records).any(-1)
    assert filled.sum() == 16
    corners = np.argwhere(filled) / 8 * 2 - 1
    assert (np.ptp(corners, axis=0) <= 0.25 + 1e-9).all()
    assert (corners.min(0) <= sensors + 1e-9).all()
    assert (corners.max(0) >= sensors - 1e-9).all()
    np.testing.assert_allclose(table.recall(sensors), registers, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(POINT, REGISTERS, REGISTERS, st.floats(0.1, 1.0))
def test_a_success_corrects_the_recall_by_its_rate(sensors, first, second, rate):
    table = GridTable(3, rate=rate)
    table.learn(sensors, first)
    table.learn(sensors, second)
    np.testing.assert_allclose(table.recall(sensors), first + rate * (second - first), atol=1e-9)


def test_nearer_corners_are_corrected_more():
    table = GridTable(1, cells=1)
    table.learn(np.zeros(4), np.zeros(1))
    table.learn(np.full(4, -0.8), np.ones(1) * 0.5)
    near, far = table.records[0, 0, 0, 0, 0], table.records[1, 1, 1, 1, 0]
    assert near > 10 * far >= 0


def test_recall_is_multilinear_between_the_corners():
    table = GridTable(1, cells=2)
    grid = np.stack(np.meshgrid(*[[-1, 0, 1]] * 4, indexing="ij"), -1)
    table.records = (grid @ [0.1, 0.2, -0.3, 0.1] + 0.05 * grid.prod(-1))[..., None]
    for sensors in np.random.default_rng(0).uniform(-1, 1, (50, 4)):
        expected = sensors @ [0.1, 0.2, -0.3, 0.1] + 0.05 * sensors.prod()
        np.testing.assert_allclose(table.recall(sensors), [expected], atol=1e-12)


@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_skill_improves_by_doing(mount):
    """Motions a trial in one small world of objects: later trials need half of the first ones'."""

    class Small(Lengths):
        def reset(self, **_):
            x, y = np.random.default_rng(len(self.lengths) + 1).uniform(-0.03, 0.03, 2)
            return super().reset(options={"object": (0.42 + x, y, 0.10)})

    env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", world="nominal")
    env.reset(seed=0)
    log = Small(env)
    agents.make("grid_table", log).learn(500)
    assert np.mean(log.lengths[-31:-1]) <= 0.5 * np.mean(log.lengths[:5])


def test_a_trial_cut_off_teaches_nothing():
    env = gym.make(
        "CalFree/Reach-v0", dynamics="kinematic", max_episode_steps=2, world="nominal", tolerance_px=1e-6
    )
    env.reset(seed=0)
    agent = agents.make("grid_table", env)
    agent.learn(40)
    assert np.isnan(agent.knowledge.records).all()
