"""The method against SciPy's, for many problems at once."""

import numpy as np
from scipy.optimize import least_squares

from agents.docking.least_squares import Quadratic, least


def residuals(place, target):
    """Of a curved valley (Rosenbrock's)."""
    return 100 * np.array([10 * (place[1] - place[0] ** 2), target - place[0]])


def near(places, targets):
    r = np.array([residuals(each, target) for each, target in zip(places, targets, strict=True)])
    slopes = 100 * np.array([[[-20 * x, -1.0], [10.0, 0.0]] for x, _ in places])
    return Quadratic((r**2).sum(1), (slopes @ r[..., None])[..., 0], slopes @ slopes.swapaxes(1, 2))


def test_each_problem_goes_where_scipy_goes():
    targets = np.array([1.0, -0.5, 0.7])
    starts = np.array([[-1.2, 1.0], [0.9, -1.0], [0.0, 0.0]])
    found = least(lambda places: near(places, targets), starts, 100, enough=-1.0)
    for place, start, target in zip(found.places, starts, targets, strict=True):
        np.testing.assert_allclose(place, least_squares(residuals, start, args=(target,)).x, atol=0.01)


def test_no_coordinate_is_beyond_its_limit():
    found = least(lambda places: near(places, [2.0]), np.zeros((1, 2)), 100, limit=1.0)
    assert np.abs(found.places).max() <= 1
    assert found.costs[0] < near(np.zeros((1, 2)), [2.0]).cost[0]
