"""Weights of M-estimators, against SciPy's loss functions."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from agents.base.weights import cauchy_weights, huber_weights

DEVIATIONS = np.array([-20.0, -3.0, -1.0, 0.0, 0.5, 2.0, 7.0])


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_weights_are_scipy_s(scale):
    """The derivatives of its ρ(deviation²), from a fit's gradient: jᵀ w r with j = 1."""
    for loss, found in (
        ("cauchy", cauchy_weights(DEVIATIONS / scale)),
        ("huber", huber_weights(DEVIATIONS, scale)),
    ):
        options = {"loss": loss, "f_scale": scale, "max_nfev": 1}
        fits = [least_squares(lambda x, r=r: x + r, [0.0], **options) for r in DEVIATIONS]
        weights = [fit.grad[0] / r if r else 1.0 for fit, r in zip(fits, DEVIATIONS, strict=True)]
        np.testing.assert_allclose(found, weights, rtol=1e-6)
