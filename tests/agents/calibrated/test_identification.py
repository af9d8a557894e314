"""What identification is made of, against finite differences, SciPy, and measurements with outliers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares as scipy_least_squares

import calfree_gym
from agents.calibrated import prediction
from agents.calibrated.identification import identify, least_squares
from agents.calibrated.prediction import Measurements, Prediction
from agents.calibrated.robot_model import RobotModel
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.robot.arms.movemaster import AIM


def built(mount):
    return RobotModel.of(calfree_gym.nominal(), mount)


def measurements_of(world, mount, rng, noise_px=0.0, trials=(8, 6, 4)):
    """What a robot like `world` measures at random registers near home, in several trials."""
    model = RobotModel.of(world, mount)
    trial = np.repeat(np.arange(len(trials)), trials)
    registers = rng.uniform(-0.15, 0.15, (len(trial), 3)) / world.motor_gain
    registers[0] = 0
    objects = AIM + rng.uniform(-0.05, 0.05, (len(trials), 3))
    points = model.points(registers, objects[trial])
    noise = noise_px * IMAGE_UNIT * rng.standard_normal(points.shape)
    return Measurements(registers, points + noise, np.ones(points.shape[:2], bool), trial), objects


def anywhere(rng, starts, trials):
    """Parameters with the standard deviations of the prior, objects included."""
    off = rng.normal(size=(starts, prediction.COUNT)) * np.minimum(prediction.PRIOR_STD, 1.0)
    objects = np.tile(AIM, (starts, trials)) + 0.05 * rng.normal(size=(starts, 3 * trials))
    return np.concatenate([off, objects], 1)


def test_derivatives_are_those_of_finite_differences(mount):
    rng = np.random.default_rng(1)
    measured, _ = measurements_of(calfree_gym.nominal(), mount, rng)
    signs, x = np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]]), anywhere(rng, 2, measured.trials)
    derivatives = Prediction(measured, built(mount), signs, x).derivatives()
    for column in range(x.shape[1]):
        step = 1e-6 * np.eye(x.shape[1])[column]
        ends = [Prediction(measured, built(mount), signs, x + side * step).points for side in (1, -1)]
        difference = (ends[0] - ends[1]) / 2e-6
        np.testing.assert_allclose(derivatives[..., column], difference, rtol=1e-4, atol=1e-4)


def curve(x):
    """Two image points that hang on three parameters, from each of several starts."""
    a, b, c = x.T
    residuals = np.stack([a**2 + b - 3, a * b * c - 1, np.exp(c) - 2 * b, a - b], -1)
    zero, one = np.zeros_like(a), np.ones_like(a)
    rows = [[2 * a, one, zero], [b * c, a * c, a * b], [zero, -2 * one, np.exp(c)], [one, -one, zero]]
    return residuals, lambda: np.moveaxis(np.array(rows), -1, 0)


@pytest.mark.parametrize("bound", [10.0, 0.3])
def test_least_squares_are_scipy_s_within_bounds_and_without(bound):
    start, prior_std = np.array([[0.8, 1.1, 0.9], [1.2, 0.9, 1.05]]), np.array([2.0, 1.0, 3.0])
    prior_mean, bounds = np.ones(3), np.full(3, bound)
    found, off, cost = least_squares(curve, start, prior_mean, prior_std, bounds, steps=100, outlying=1e6)
    for i in range(2):
        expected = scipy_least_squares(
            lambda x: np.concatenate([curve(x[None])[0][0], (x - prior_mean) / prior_std]),
            np.clip(start[i], prior_mean - bound, prior_mean + bound),
            bounds=(prior_mean - bound, prior_mean + bound),
        )
        assert cost[i] <= expected.cost * 1.002
        np.testing.assert_allclose(found[i], expected.x, atol=0.02)
        np.testing.assert_allclose(off[i], curve(found[i][None])[0][0])


@pytest.mark.parametrize("seed", [3001, 3005, 3008])
def test_a_mistaken_point_spoils_nothing(mount, seed):
    world, rng = calfree_gym.WorldDistribution("wild").sample(seed), np.random.default_rng(seed)
    measured, _ = measurements_of(world, mount, rng, noise_px=0.5)
    points = measured.points.copy()
    points[3, 1] = [0.7, -0.6]
    residuals_px = identify(replace(measured, points=points), built(mount)).residuals_px
    assert np.abs(residuals_px[3, 1]).max() > 30
    residuals_px[3, 1] = 0
    assert np.sqrt(np.mean(residuals_px**2)) < 0.7


def test_an_object_that_one_camera_never_saw_is_looked_for_where_the_other_saw_it(mount):
    measured, _ = measurements_of(calfree_gym.nominal(), mount, np.random.default_rng(3), trials=(12,))
    seen = measured.seen.copy()
    seen[:, 2] = False
    found = identify(replace(measured, seen=seen), built(mount))
    np.testing.assert_array_equal(found.signs, calfree_gym.nominal().motor_sign)
    assert np.abs(found.residuals_px).max() < 1
