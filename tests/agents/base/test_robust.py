"""Weights of M-estimators, against SciPy's loss functions."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from agents.base.weights import cauchy_weights, huber_weights

DEVIATIONS = np.array([-20.0, -3.0, -1.0, 0.0, 0.5, 2.0, 7.0])


def scipy_weights(loss):
    """The derivatives of SciPy's ρ(deviation²), from a fit's gradient: jᵀ w r with j = 1."""
    fits = [least_squares(lambda x, r=r: x + r, [0.0], loss=loss, max_nfev=1) for r in DEVIATIONS]
    return [fit.grad[0] / r if r else 1.0 for fit, r in zip(fits, DEVIATIONS, strict=True)]


def test_cauchy_s_weights_are_scipy_s():
    np.testing.assert_allclose(cauchy_weights(DEVIATIONS), scipy_weights("cauchy"), rtol=1e-6)


def test_huber_s_weights_are_scipy_s():
    np.testing.assert_allclose(huber_weights(DEVIATIONS, 1.0), scipy_weights("huber"), rtol=1e-6)


@pytest.mark.parametrize("limit", [0.5, 3.0])
def test_huber_s_limit_is_where_weights_begin_to_fall(limit):
    assert huber_weights(np.array([limit]), limit) == 1
    assert huber_weights(np.array([2 * limit]), limit) == 0.5
