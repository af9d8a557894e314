"""Bayesian linear regression against least squares, and a Gaussian process through its looks."""

import numpy as np
import pytest

from agents.rivals.regression import BayesianRegression
from agents.rivals.residuals import ResidualProcess


@pytest.mark.parametrize("block", [1, 7, 100])
def test_however_looks_come_they_give_the_least_squares_with_the_prior_as_looks_of_zero(block):
    rng = np.random.default_rng(0)
    features, targets = rng.normal(size=(100, 5)), rng.normal(size=(100, 2))
    variances, deviations = rng.uniform(0.01, 1, 100), rng.uniform(0.1, 2, 5)
    regression = BayesianRegression(deviations, 2)
    regression.BLOCK = block
    regression.learn(features, targets, variances)
    weights = 1 / np.sqrt(variances)[:, None]
    rows = np.vstack([features * weights, np.diag(1 / deviations)])
    expected = np.linalg.lstsq(rows, np.vstack([targets * weights, np.zeros((5, 2))]))[0]
    np.testing.assert_allclose(regression.mean, expected, rtol=1e-9, atol=1e-12)
    inverse = np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(regression.covariance, inverse, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(
        regression.variances(features), np.einsum("ni,ij,nj->n", features, inverse, features), rtol=1e-8
    )


def test_residuals_are_met_where_they_were_seen_and_fade_far_away():
    rng = np.random.default_rng(0)
    places, residuals = rng.uniform(-1, 1, (6, 3)), rng.normal(size=(6, 2))
    process = ResidualProcess(places, residuals, np.full(6, 1e-9), deviation=1.0, length=0.3)
    np.testing.assert_allclose(process.mean(places), residuals, atol=1e-4)
    np.testing.assert_allclose(process.mean(places + 10), 0, atol=1e-9)
