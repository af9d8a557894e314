"""Tables of one and two coordinates, combined (paper, section 4.3)."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.knowledge.factored_table import PAIRS as ALL_PAIRS
from agents.knowledge.factored_table import FactoredTable

POINT = st.lists(st.floats(-1, 1), min_size=4, max_size=4).map(np.array)

PAIRS = ALL_PAIRS[:4]
"""Those of keys of four dimensions."""


def parts(sensors):
    """A sum of parts of which no table can do without: each of one coordinate, or of a pair (n, 2)."""
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
    for sensors, registers in zip(shown, parts(np.array(shown)), strict=True):
        table.learn(sensors, registers)
    hidden = np.array([p for p in rng.uniform(-0.6, 0.6, (400, 4)) if p[0] + p[3] > 0.6])
    missed = np.abs([table.recall(p).registers for p in hidden] - parts(hidden))
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
