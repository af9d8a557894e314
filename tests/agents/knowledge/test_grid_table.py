"""The paper's table against what section 4.2 says of it."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
from agents.knowledge.grid_table import GridTable

POINT = st.lists(st.floats(-1, 1), min_size=4, max_size=4).map(np.array)
CORNERS = np.array(list(np.ndindex(9, 9, 9, 9))) / 4 - 1
REGISTERS = st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3).map(np.array)


@settings(max_examples=50)
@given(POINT, REGISTERS, REGISTERS, st.floats(0.1, 1.0))
def test_the_first_success_fills_all_corners_of_its_cell_and_others_correct_them_by_their_rate(
    sensors, first, second, rate
):
    table = GridTable(3, rate=rate)
    assert table.recall(sensors) is None
    table.learn(sensors, first)
    assert table.records.shape == (6561, 3)
    filled = ~np.isnan(table.records).any(1)
    assert filled.sum() == 16
    corners = CORNERS[filled]
    assert (np.ptp(corners, axis=0) <= 0.25 + 1e-9).all()
    assert (corners.min(0) <= sensors + 1e-9).all()
    assert (corners.max(0) >= sensors - 1e-9).all()
    np.testing.assert_allclose(table.recall(sensors).registers, first, atol=1e-12)
    table.learn(sensors, second)
    np.testing.assert_allclose(table.recall(sensors).registers, first + rate * (second - first), atol=1e-9)


def test_recall_is_multilinear_between_the_corners():
    table = GridTable(1, cells=2)
    grid = np.stack(np.meshgrid(*[[-1, 0, 1]] * 4, indexing="ij"), -1)
    table.records = (grid @ [0.1, 0.2, -0.3, 0.1] + 0.05 * grid.prod(-1)).reshape(81, 1)
    for sensors in np.random.default_rng(0).uniform(-1, 1, (50, 4)):
        expected = sensors @ [0.1, 0.2, -0.3, 0.1] + 0.05 * sensors.prod()
        np.testing.assert_allclose(table.recall(sensors).registers, [expected], atol=1e-12)


def test_a_trial_cut_off_teaches_nothing(make_env):
    env = make_env(max_episode_steps=2, world="nominal", tolerance_px=1e-6)
    env.reset(seed=0)
    agent = agents.make("grid_table", env)
    agent.learn(40)
    assert np.isnan(agent.knowledge.records).all()


def test_a_kalman_filter_averages_noise_and_forgets_when_time_goes_by():
    noise, misses = np.random.default_rng(0).normal(0, 0.1, 200), []
    for kalman in (False, True):
        table, ends = GridTable(1, cells=1, kalman=kalman), []
        for error in noise:
            table.learn(np.zeros(4), np.array([error]))
            ends.append(table.recall(np.zeros(4)).registers[0])
        misses.append(np.std(ends[50:]))
    assert misses[1] < misses[0]
    table = GridTable(1, cells=8, kalman=True)
    table.learn(np.full(4, 0.9), np.zeros(1))
    before = table.recall(np.full(4, 0.9)).deviation_px
    for _ in range(100):
        table.learn(np.full(4, -0.9), np.zeros(1))
    assert table.recall(np.full(4, 0.9)).deviation_px > before
