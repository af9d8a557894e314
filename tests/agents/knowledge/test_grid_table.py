"""The paper's tables, against sections 4.2 and 4.3."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
from agents.knowledge.factored_table import PAIRS as ALL_PAIRS
from agents.knowledge.factored_table import FactoredTable
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
    assert [cells.sum() for cells in table.known_cells()] == [1, 0], "filled, and trusted"
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


PAIRS = ALL_PAIRS[:4]
"""Those of keys of four dimensions."""


def sums_of_parts(sensors):
    """Sums of parts of which no table can do without: each of one coordinate, or of a pair (n, 2)."""
    xa, ya, xb, yb = sensors.T
    return np.stack([np.sin(2 * xa) + 0.8 * xb * xa - yb**2, np.exp(ya) / 2 - xb * yb + 0.5 * ya * yb], 1)


@settings(max_examples=50)
@given(POINT, st.integers(1, 9))
def test_the_tables_interpolate(sensors, cells):
    table = FactoredTable(1, cells=cells)
    x = np.linspace(-1, 1, cells + 1)
    lines = [slope * x for slope in (0.1, 0.2, -0.3, 0.4)]
    planes = [(np.outer(x, x) * 0.1 + x[:, None]).ravel() for _ in PAIRS]
    table.records = np.concatenate([*lines, *planes])[:, None]
    table.covariance = 1e-6 * np.eye(len(table.records))
    expected = sensors @ [0.1, 0.2, -0.3, 0.4] + sum(
        0.1 * sensors[i] * sensors[j] + sensors[i] for i, j in PAIRS
    )
    np.testing.assert_allclose(table.recall(sensors).registers, [expected], atol=1e-9)


def test_it_learns_any_sum_of_parts_also_where_nothing_was_shown():
    rng = np.random.default_rng(0)
    table = FactoredTable(2)
    shown = [p for p in rng.uniform(-0.7, 0.7, (900, 4)) if p[0] + p[3] < 0.5]
    for sensors, registers in zip(shown, sums_of_parts(np.array(shown)), strict=True):
        table.learn(sensors, registers)
    hidden = np.array([p for p in rng.uniform(-0.6, 0.6, (400, 4)) if p[0] + p[3] > 0.6])
    missed = np.abs([table.recall(p).registers for p in hidden] - sums_of_parts(hidden))
    assert missed.max() < 0.1
    assert np.median(missed) < 0.02


def test_the_filter_is_least_squares():
    rng = np.random.default_rng(1)
    table = FactoredTable(1, cells=3)
    prior, noise = table.covariance.copy(), FactoredTable.SUCCESS_VARIANCE
    sensors, registers = rng.uniform(-1, 1, (30, 4)), rng.normal(size=(30, 1))
    rows = np.zeros((30, len(prior)))
    for row, place in zip(rows, sensors, strict=True):
        which, weights = table._between(place)
        np.add.at(row, which, weights)
    object.__setattr__(table.gain, "drift_variance", 0.0)
    for pair in zip(sensors, registers, strict=True):
        table.learn(*pair)
    expected = prior @ rows.T @ np.linalg.solve(rows @ prior @ rows.T + noise * np.eye(30), registers)
    np.testing.assert_allclose(table.records, expected, atol=1e-7)
