"""Noise, gates and visibility, each alone."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from agents.base.observation import Observation
from agents.servo.perception import Gating, NoiseEstimate, Visibility
from calfree_gym.image import IMAGE_UNIT

PREDICTED = np.zeros((4, 2))
RADII = np.full(4, 30.0)


def seen(px):
    """All points in place but the first, so many pixels (2,) away."""
    points = PREDICTED.copy()
    points[0] += np.array(px) * IMAGE_UNIT
    return Observation(points, np.ones(4, bool), np.zeros(3))


def test_homes_tell_the_noise_until_some_is_seen_in_a_row():
    rng, noise = np.random.default_rng(0), NoiseEstimate()
    for _ in range(30):
        noise.add_homes(np.diff(rng.normal(scale=2 * IMAGE_UNIT, size=(2, 4, 2)), axis=0)[0])
    assert noise.px == pytest.approx(2, rel=0.2)
    for _ in range(30):
        noise.add_homes(rng.normal(scale=60 * IMAGE_UNIT, size=(4, 2)))
    assert noise.px > NoiseEstimate.NOISY_PX
    assert not noise.measured
    for _ in range(10):
        noise.add(np.diff(rng.normal(scale=2 * IMAGE_UNIT, size=(2, 4, 2)), axis=0)[0])
    assert noise.px == pytest.approx(2, rel=0.2)
    assert noise.measured


def test_gates_end_where_a_point_is_as_likely_to_be_mistaken_as_right():
    deviations_px, noise_px, share = np.array([1.0, 5.0, 20.0, 80.0]), 3.0, Gating.MISTAKEN / Gating.OF
    radii = Gating().radii(deviations_px, noise_px)
    scales = np.hypot(deviations_px, noise_px)
    right = multivariate_t(shape=np.eye(2), df=Gating.TAILS)
    densities = [right.pdf([r / s, 0]) / s**2 for r, s in zip(radii, scales, strict=True)]
    np.testing.assert_allclose(np.array(densities) * (1 - share), share / 512**2, rtol=1e-6)


def test_points_outside_their_gates_are_trusted_where_two_observations_agree_and_only_there():
    apart = Gating().estimate([seen([90.0, 0.0]), seen([-90.0, 40.0])], PREDICTED, RADII, 0.7)
    np.testing.assert_array_equal(apart.points, PREDICTED)
    assert apart.found.tolist() == [False, True, True, True]
    observations = [seen([90.0, 0.0]), seen([-90.0, 40.0]), seen([92.0, 0.0])]
    agreeing = Gating().estimate(observations, PREDICTED, RADII, 0.7)
    np.testing.assert_allclose(agreeing.points[0], [91 * IMAGE_UNIT, 0])
    assert agreeing.inconsistent.tolist() == [True, False, False, False]


ALL, HIDDEN = np.ones(4, bool), np.array([True, False, True, True])


@pytest.mark.parametrize(("gaps", "patience"), [(False, 1), (True, 4)])
def test_a_point_is_lost_that_was_not_seen_for_longer_than_gaps_last(gaps, patience):
    visibility = Visibility()
    visibility.gaps = gaps
    for _ in range(patience):
        visibility.add(HIDDEN, again=False)
        assert not visibility.lost.any()
    visibility.add(HIDDEN, again=False)
    assert visibility.lost.tolist() == [False, True, False, False]
    visibility.add(ALL, again=False)
    assert not visibility.lost.any()


def test_where_looking_again_never_helped_a_point_is_lost_at_once():
    visibility = Visibility()
    for _ in range(2):
        visibility.add(HIDDEN, again=False)
        assert not visibility.lost.any()
        visibility.add(HIDDEN, again=True)
        assert visibility.lost[1]
        visibility.add(ALL, again=False)
    visibility.add(HIDDEN, again=False)
    assert visibility.lost[1]
    assert not visibility.gaps
    for _ in range(3):
        visibility.add(ALL, again=True)
        visibility.add(HIDDEN, again=False)
    assert visibility.may_return
    assert visibility.gaps
